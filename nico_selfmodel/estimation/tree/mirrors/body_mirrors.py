"""Mirrors that a known body sees itself in while its head moves: planes in its world.

The body is held as it was learned, but not taken for exact: see `known_with_errors`.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.dataset.body.body_dataset import BodyDataset
from nico_selfmodel.errors import DataError, ModelError
from nico_selfmodel.estimation.results.provenance import package_versions
from nico_selfmodel.estimation.tree.forward.tree_residuals import TreeResiduals
from nico_selfmodel.estimation.tree.mirrors.glass_flatness import flatness_of_glasses
from nico_selfmodel.estimation.tree.mirrors.known_with_errors import (
    NewParameters,
    drifts_of,
    new_parameters,
)
from nico_selfmodel.estimation.tree.mirrors.mirrored_tree import names_of_mirrors, place_mirrors
from nico_selfmodel.estimation.tree.tree_calibration import TreeCalibration, refit_tree
from nico_selfmodel.estimation.tree.tree_errors import TreeErrors, errors_of, told_as
from nico_selfmodel.estimation.tree.tree_observations import TreeObservations
from nico_selfmodel.estimation.tree.tree_parameters import TreeParameters
from nico_selfmodel.estimation.tree.tree_problem import TreeProblem
from nico_selfmodel.estimation.tree.tree_solution import TreeNoise, TreeSolution
from nico_selfmodel.model.self_model import ParameterCovariance
from nico_selfmodel.model.tree.body_model import BodyModel
from nico_selfmodel.model.tree.body_tree import BodyTree
from nico_selfmodel.optimization.uncertainty import Uncertainty, root_of

_STEPS = 3
"""From the planes of an exact body to those of one that may err: nearly linear."""


@dataclass(frozen=True, eq=False)
class BodyMirrors:
    """Mirrors learned by a body that is known."""

    found: TreeCalibration
    """The adjustment of the planes, the body held."""
    model: BodyModel
    """The body with the mirrors, and what is known of both together."""


def calibrate_body_mirrors(
    data: BodyDataset,
    model: BodyModel,
    *,
    test: BodyDataset | None = None,
    name: str | None = None,
) -> BodyMirrors:
    """Learn the planes of all mirrors in which a body's cameras saw its markers.

    What was seen directly at the same poses tells where the joints were then. Noise is that of the
    body's training, where it tells.

    Args:
        data: The recording.
        model: The body.
        test: Held-out data, for judging only.
        name: Of the body with its mirrors; its own if omitted.

    Returns:
        The planes in the body's world, with standard deviations that count the body's own.

    Raises:
        DataError: If the recording is of another body, names no mirror, or a glass would be behind
            the cameras.
        ModelError: If the body has no cameras.
        NotIdentifiableError: If too little was seen in a mirror.
    """
    tree, told = _before_mirrors(data, model)
    seen, names = TreeObservations.of(told), names_of_mirrors(told.mirrors)
    parameters = TreeParameters(tree)
    parameters, values = place_mirrors(
        seen, parameters, parameters.values_of(tree), names, {}, seen.data.mirrors
    )
    found = refit_tree(
        parameters.tree_of(values),
        told,
        names,
        world=str(model.provenance.get("world", "world")),
        name=name or model.name,
        noise=_known_noise(model, seen),
        start=model.name,
    )
    found, covariance = _with_errors_of_body(found, model.covariance)
    held_out = None if test is None else errors_of(found.tree, test)
    expected = {**model.provenance, "mirrors": {"dataset": data.name, **package_versions("drake")}}
    learned = replace(
        model,
        name=name or model.name,
        tree=found.tree,
        covariance=covariance,
        provenance=expected,
    )
    return BodyMirrors(replace(found, test=held_out), learned)


def _before_mirrors(data: BodyDataset, model: BodyModel) -> tuple[BodyTree, BodyDataset]:
    """Return the body without the mirrors that are learned, and the recording in its markers."""
    if not model.tree.lenses:
        raise ModelError(
            f"body {model.name!r} has no cameras, so that it cannot look into a mirror: learn it "
            "from what cameras saw, with `nico-selfmodel calibrate body`"
        )
    if not data.mirrors:
        raise DataError(
            f"data set {data.name!r} has no reflection: the column `mirror` must name the mirror "
            "in rows whose pixels were seen in it"
        )
    others = tuple(mirror for mirror in model.tree.mirrors if mirror.name not in data.mirrors)
    tree, table = replace(model.tree, mirrors=others), data.observations
    direct = replace(data, observations=replace(table, mirror=np.full(len(table), "")))
    told = told_as(tree, direct)
    return tree, replace(told, observations=replace(told.observations, mirror=table.mirror))


def _known_noise(model: BodyModel, seen: TreeObservations) -> TreeNoise | None:
    """Return the noise of a body's training; None where it does not tell all that is needed."""
    joints = [model.tree.joints[i] for i, _ in seen.noisy_joints]
    parts = ["" if name in model.noise else " turn" if part < 3 else " place"
             for name, (_, part) in zip(joints, seen.noisy_joints, strict=True)]  # fmt: skip
    noisy = [f"{name}{part}" for name, part in zip(joints, parts, strict=True)]
    if not set(noisy) | set(seen.noise_groups) <= set(model.noise):
        return None
    sensor, joint = (np.array([model.noise[n] for n in names]) for names in
                     (seen.noise_groups, noisy))  # fmt: skip
    return TreeNoise(sensor, joint)


def _with_errors_of_body(
    found: TreeCalibration, body: ParameterCovariance | None
) -> tuple[TreeCalibration, ParameterCovariance]:
    """Return planes that count the body's errors, and the covariance of body and planes."""
    residuals = TreeResiduals(found.train.observations, found.parameters)
    planes, body = found.uncertainty.names, _without(body, found.uncertainty.names)
    drifts = drifts_of(found.tree, found.train.observations)
    bends = TreeResiduals(residuals.observations, residuals.parameters.with_bending(drifts.bending))
    free = frozenset((*planes, *body.names, *drifts.names))
    problem = TreeProblem(bends, free, {}, found.solution.noise, noise_known=True)
    names, still = problem.free_names, np.zeros(len(bends.parameters.names) - len(found.values))
    own, known, drifting = ([names.index(n) for n in s] for s in (planes, body.names, drifts.names))
    L = root_of(body.matrix)
    largest, solution = float(found.solution.noise.joint.max(initial=0.0)), found.solution

    def at(solution: TreeSolution) -> TreeSolution:
        return replace(solution, values=np.append(solution.values, still))

    def weighed(solution: TreeSolution) -> tuple[NewParameters, int]:
        U, white = problem.whitened_at(at(solution))
        drift = U[:, drifting] * drifts.scale
        return new_parameters(U[:, own], U[:, known] @ L, drift, white, largest), len(white)

    for _ in range(_STEPS):
        values = solution.values.copy()
        values[problem.columns[own]] += weighed(solution)[0].step
        solution = replace(solution, values=values)
    new, count = weighed(solution)
    may_err = np.zeros((len(names), L.shape[1] + len(drifting)))
    may_err[known, : L.shape[1]] = L
    may_err[drifting, L.shape[1] :] = np.diag(new.drift * drifts.scale)
    uncertainty = _uncertainty(found, planes, new.information, count)
    across = new.with_body @ L.T
    matrix = np.block([[body.matrix, across.T], [across, uncertainty.covariance]])
    moved = replace(
        found,
        tree=found.parameters.tree_of(solution.values),
        solution=solution,
        uncertainty=uncertainty,
        train=TreeErrors(found.train.observations, residuals.residuals(solution.values)),
        flatness=flatness_of_glasses(problem, at(solution), np.array(own), may_err),
    )
    return moved, ParameterCovariance((*body.names, *planes), matrix)


def _uncertainty(
    found: TreeCalibration, names: tuple[str, ...], information: NDArray, count: int
) -> Uncertainty:
    """Return the covariance of the planes; the noise is that of the body's training, or found."""
    squares, vectors = np.linalg.eigh(information)
    root = np.sqrt(np.maximum(squares, 0.0))[:, None] * vectors.T
    scales = found.parameters.scales(1.0, found.values)
    natural = scales[[found.parameters.index[name] for name in names]]
    return Uncertainty.from_jacobian(names, root, natural, float(count - len(names)), count)


def _without(body: ParameterCovariance | None, names: tuple[str, ...]) -> ParameterCovariance:
    """Return what is known of a body, not of what is learned anew."""
    if body is None:
        return ParameterCovariance((), np.zeros((0, 0)))
    kept = [i for i, name in enumerate(body.names) if name not in names]
    return ParameterCovariance(tuple(body.names[i] for i in kept), body.matrix[np.ix_(kept, kept)])
