"""Where the adjustment of a body begins: a first body, adjusted roughly."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.dataset.body.body_dataset import BodyDataset
from nico_selfmodel.estimation.tree.forward.tree_residuals import TreeResiduals
from nico_selfmodel.estimation.tree.mirrors.mirrored_tree import (
    anywhere,
    apart_from,
    names_of_mirrors,
    place_mirrors,
)
from nico_selfmodel.estimation.tree.tree_observations import TreeObservations
from nico_selfmodel.estimation.tree.tree_parameters import TreeParameters
from nico_selfmodel.estimation.tree.tree_problem import TreeProblem
from nico_selfmodel.estimation.tree.tree_setup import Description, TreeSetup, Wishes, setup_of
from nico_selfmodel.model.tree.body_tree import BodyTree


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
            tree: The body.
            data: The recording.
            observations: What of it counts.
            description: The robot as described, where it is.
            wishes: What the user holds, frees or knows.
        """
        unplaced = apart_from(tree, data.mirrors)
        tree = tree.with_mirrors(anywhere(unplaced))
        base = tree if description is None else _base_of(description, tree)
        parameters = TreeParameters(base)
        setup = setup_of(data, parameters, description, wishes)
        seen, planes = observations, names_of_mirrors(unplaced)
        if planes:
            placed = ~np.isin(data.observations.mirror, unplaced)
            observations = TreeObservations.of(data, placed)
        free = setup.free - planes
        tree = tree.scaled(_length_factor(setup, parameters, tree))
        values = parameters.values_of(tree)
        for name, value in setup.fixed.items():
            values[parameters.index[name]] = value
        if description is not None and tree.lenses:
            rays = TreeResiduals(observations.as_bearings(tree.lenses), parameters)
            inside = parameters.of_lenses
            for held in (inside | parameters.of_joint_frames, inside):
                values = TreeProblem(rays, free - held, setup.priors).rough(values)[0]
        problem = TreeProblem(TreeResiduals(observations, parameters), free, setup.priors)
        values, cost = problem.rough(values)
        if planes:
            parameters, values = place_mirrors(
                seen, parameters, values, setup.free, setup.fixed, unplaced
            )
            problem = TreeProblem(TreeResiduals(seen, parameters), setup.free, setup.priors)
            values, cost = problem.rough(values)
        if description is None:
            # Told from where they are now, joint frames keep their names to first order: what is
            # refined, its covariance and its folds then speak of the same parameters.
            tree = parameters.tree_of(values)
            parameters = TreeParameters(tree)
            values = parameters.values_of(tree)
        return cls(label, parameters, setup, values, cost)


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
