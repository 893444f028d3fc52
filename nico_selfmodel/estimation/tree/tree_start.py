"""Where the adjustment of a body begins: a first body, adjusted roughly."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.dataset.body.body_dataset import BodyDataset
from nico_selfmodel.errors import DataError
from nico_selfmodel.estimation.tree.forward.tree_residuals import TreeResiduals
from nico_selfmodel.estimation.tree.guesses.told_frames import framed, told_size
from nico_selfmodel.estimation.tree.guesses.touch_guess import Touches
from nico_selfmodel.estimation.tree.mirrors.mirrored_tree import (
    anywhere,
    apart_from,
    names_of_mirrors,
    place_mirrors,
)
from nico_selfmodel.estimation.tree.tree_observations import TreeObservations
from nico_selfmodel.estimation.tree.tree_parameters import SHIFTS, TreeParameters
from nico_selfmodel.estimation.tree.tree_problem import TreeProblem
from nico_selfmodel.estimation.tree.tree_setup import (
    Description,
    TreeSetup,
    Wishes,
    held_scale,
    setup_of,
)
from nico_selfmodel.estimation.tree.tree_solution import TreeNoise, TreeSolution
from nico_selfmodel.model.tree.body_tree import BodyTree

_TURNS = 4
"""How often what holds lengths is chosen anew, as a first body is adjusted."""


@dataclass(frozen=True, eq=False)
class TreeStart:
    """A first body, adjusted roughly."""

    label: str
    """Where it comes from."""
    parameters: TreeParameters
    """Its parameters."""
    setup: TreeSetup
    """What is estimated."""
    values: NDArray
    """Of the parameters. Shape (P,)."""
    cost: float
    """By which starts are compared."""

    def refined(
        self, observations: TreeObservations, noise: TreeNoise | None = None
    ) -> tuple[TreeProblem, TreeSolution]:
        """Adjust it to the end; return the problem, and where that is.

        Args:
            noise: What disturbs it, where that is known; estimated if omitted.

        Raises:
            ContradictedError: If every observation is an outlier.
            DataError: If there are fewer numbers than there are parameters.
        """
        residuals, setup = TreeResiduals(observations, self.parameters), self.setup
        if len(setup.free) > observations.scalars + len(setup.priors):
            raise DataError(
                f"data set {observations.data.name!r} has {observations.scalars} numbers for "
                f"{len(setup.free)} parameters: record more poses, or fix parameters"
            )
        known = {"noise": noise, "noise_known": noise is not None}
        problem = TreeProblem(residuals, setup.free, setup.priors, **known, alike=setup.alike)
        return problem, problem.refine(self.values)

    @classmethod
    def from_body(
        cls,
        label: str,
        tree: BodyTree,
        data: BodyDataset,
        observations: TreeObservations,
        description: Description | None,
        wishes: Wishes,
    ) -> "TreeStart":
        """Adjust a first body, bearings before pixels where it comes from a description.

        Args:
            label: Where it comes from.
            description: The robot as described, where it is.
        """
        unplaced, touches = apart_from(tree, data.mirrors), Touches.of(data)
        tree = tree.with_mirrors(anywhere(unplaced))
        base = tree if description is None else _base_of(description, tree)
        parameters = TreeParameters(base)
        setup = setup_of(data, parameters, description, wishes)
        if setup.told:
            tree = framed(tree, setup.told, sized=setup.scale_from != told_size(tree, setup.told))
            parameters = TreeParameters(tree)
        values = parameters.values_of(tree.scaled(_length_factor(setup, parameters, tree)))
        for name, value in setup.fixed.items():
            values[parameters.index[name]] = value
        seen, planes = observations, names_of_mirrors(unplaced)
        waiting = touches.rows | np.isin(data.observations.mirror, unplaced)
        if waiting.any():
            observations = TreeObservations.of(data, ~waiting)
        cost = np.inf
        if observations.sensors:
            free = setup.free - planes - touches.names
            begin = _by_bearings if description is not None and tree.lenses else _roughly
            values, cost = begin(observations, parameters, values, free, setup)
            for _ in range(_TURNS):
                turned = _held_anew(parameters, values, setup, wishes)
                if turned is None:
                    break
                setup, values = turned
                free = setup.free - planes - touches.names
                values, cost = begin(observations, parameters, values, free, setup)
        if touches.rows.any():
            parameters, values = _with_touches(touches, parameters, values, setup)
        if planes:
            parameters, values = place_mirrors(
                seen, parameters, values, setup.free, setup.fixed, unplaced
            )
        if waiting.any():
            values, cost = _roughly(seen, parameters, values, setup.free, setup)
        if description is None:
            parameters, values = _told_from_there(data, parameters, values)
        return cls(label, parameters, setup, values, cost)


def _held_anew(
    parameters: TreeParameters, values: NDArray, setup: TreeSetup, wishes: Wishes
) -> tuple[TreeSetup, NDArray] | None:
    """Hold lengths by what is the largest part of a camera's place by now; None where it is held.

    A part that has become small holds nothing: as the camera's place turns on, all lengths grow
    without end. The camera is as far away as it was at first.
    """
    tree, base = parameters.tree_of(values), parameters.base
    held = held_scale(tree, setup.world, setup.free)
    if held is None or setup.scale_from is not None or held not in setup.free:
        return None
    camera = held.rpartition(".")[0]
    parts = {f"{camera}.{part}" for part in SHIFTS} - wishes.pins.pinned.keys()
    apart = [
        float(np.linalg.norm(next(s.X_LA[:3, 3] for s in of.sensors if s.name == camera)))
        for of in (base, tree)
    ]
    setup = replace(setup, free=(setup.free | parts) - {held})
    return setup, parameters.values_of(tree.scaled(apart[0] / apart[1]))


def _roughly(
    seen: TreeObservations,
    parameters: TreeParameters,
    values: NDArray,
    free: frozenset[str],
    setup: TreeSetup,
) -> tuple[NDArray, float]:
    """Adjust roughly; return the values, and a cost by which starts compare."""
    return TreeProblem(TreeResiduals(seen, parameters), free, setup.priors).rough(values)


def _by_bearings(
    seen: TreeObservations,
    parameters: TreeParameters,
    values: NDArray,
    free: frozenset[str],
    setup: TreeSetup,
) -> tuple[NDArray, float]:
    """The same, bearings before pixels, joints last."""
    rays, inside = seen.as_bearings(parameters.base.lenses), parameters.of_lenses
    for held in (inside | parameters.of_joint_frames, inside):
        values = _roughly(rays, parameters, values, free - held, setup)[0]
    return _roughly(seen, parameters, values, free, setup)


def _told_from_there(
    data: BodyDataset, parameters: TreeParameters, values: NDArray
) -> tuple[TreeParameters, NDArray]:
    """Tell joint frames and planes from where they are, but for planes whose place was told.

    They keep their names to first order: what is refined, its covariance and its folds then speak
    of the same parameters.
    """
    tree, told = parameters.tree_of(values), {s.name for s in data.sensors if s.X_LS is not None}
    both = zip(parameters.base.planes, tree.planes, strict=True)
    kept = tuple(first if first.name in told else now for first, now in both)
    parameters = TreeParameters(replace(tree, planes=kept))
    return parameters, parameters.values_of(tree)


def _with_touches(
    touches: Touches, parameters: TreeParameters, values: NDArray, setup: TreeSetup
) -> tuple[TreeParameters, NDArray]:
    """Place what is touched; parts of planes are then told from where they are."""
    told = {name: mean for name, (mean, _) in setup.priors.items()} | dict(setup.fixed)
    tree = touches.placed(parameters.tree_of(values))
    if setup.scale_from is not None:
        tree = tree.scaled(touches.scale(tree, told))
    parameters = TreeParameters(replace(parameters.base, planes=tree.planes))
    values = parameters.values_of(tree)
    for name in touches.names & set(setup.fixed):
        values[parameters.index[name]] = setup.fixed[name]
    return parameters, values


def _base_of(description: Description, tree: BodyTree) -> BodyTree:
    """Return the described joints with the tree's markers and sensors, to tell changes from."""
    return replace(tree, X_PJ=description.tree.X_PJ)


def _length_factor(setup: TreeSetup, parameters: TreeParameters, tree: BodyTree) -> float:
    """Return what makes a first body as large as the one length says that the user knows."""
    if setup.scale_from not in parameters.index:
        return 1.0
    mean, _ = setup.priors.get(setup.scale_from, (0.0, 0.0))
    known = setup.fixed.get(setup.scale_from, mean)
    now = float(parameters.values_of(tree)[parameters.index[setup.scale_from]])
    # Of the other sign it is another first body's length.
    return known / now if known * now > 0.0 else 1.0
