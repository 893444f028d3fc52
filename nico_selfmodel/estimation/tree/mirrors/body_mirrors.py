"""Mirrors that a known body sees itself in while its head moves: planes in its world.

The body is held as it was learned, but not taken for exact: see `estimation.tree.known`.

Whether a glass is flat: a flat one shows a point p at p' = S p - 2 d n to every camera, wherever
the head has it. A bent one shows it elsewhere, to each camera in its own way:
p'' = p' + w x (p' - o) + v, with six numbers a camera, follows that as free reflected cameras do
before cameras that stand still. One plane is among them; what they fit better is held against
chance (`estimation.diagnosis.flatness`).
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.blas_threads import on_one_blas_thread
from nico_selfmodel.dataset.body.body_dataset import BodyDataset
from nico_selfmodel.errors import DataError, ModelError
from nico_selfmodel.estimation.diagnosis.flatness import STEADYING, Flatness, flatness_by
from nico_selfmodel.estimation.results.provenance import package_versions
from nico_selfmodel.estimation.tree.forward.sights import sight_of
from nico_selfmodel.estimation.tree.forward.tree_residuals import TreeResiduals
from nico_selfmodel.estimation.tree.known.learned_anew import learn_anew
from nico_selfmodel.estimation.tree.mirrors.mirrored_tree import names_of_mirrors, place_mirrors
from nico_selfmodel.estimation.tree.tree_calibration import TreeCalibration
from nico_selfmodel.estimation.tree.tree_errors import errors_of, told_as
from nico_selfmodel.estimation.tree.tree_noise import noise_named
from nico_selfmodel.estimation.tree.tree_observations import TreeObservations
from nico_selfmodel.estimation.tree.tree_parameters import TreeParameters
from nico_selfmodel.estimation.tree.tree_problem import TreeProblem
from nico_selfmodel.estimation.tree.tree_solution import TreeSolution
from nico_selfmodel.geometry.reflection import reflect
from nico_selfmodel.geometry.rotation import skew
from nico_selfmodel.model.tree.body_model import BodyModel
from nico_selfmodel.model.tree.body_tree import BodyTree


@dataclass(frozen=True, eq=False)
class BodyMirrors:
    """Mirrors learned by a body that is known."""

    found: TreeCalibration
    """The adjustment of the planes, the body held."""
    model: BodyModel
    """The body with the mirrors, and what is known of both together."""


@on_one_blas_thread
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
    learned = learn_anew(
        model,
        parameters.tree_of(values),
        told,
        names,
        noise=noise_named(model.noise, seen),
        name=name,
    ).asked_what_changed()
    flat = flatness_of_glasses(learned.problem, learned.solution, learned.learned, learned.may_err)
    held_out = None if test is None else errors_of(learned.found.tree, test)
    found = replace(learned.found, flatness=flat, test=held_out)
    told_of = {**model.provenance, "mirrors": {"dataset": data.name, **package_versions("drake")}}
    return BodyMirrors(found, replace(learned.body(model, name), provenance=told_of))


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


def flatness_of_glasses(
    problem: TreeProblem, solution: TreeSolution, planes: NDArray, may_err: NDArray
) -> Mapping[str, Flatness | None]:
    """Test whether each mirror of a recording is flat.

    Args:
        problem: The body with its mirrors; all that may err is free.
        solution: Where its planes fit best.
        planes: Numbers of the planes' parameters among what is free. Shape (p,).
        may_err: Ways in which what is free may err, each as large as it is expected to be: their
            coordinates are N(0, 1). Shape (free, k).

    Returns:
        The tests by mirror; None where there are too few reflections.
    """
    out: dict[str, Flatness | None] = {}
    for mirror in problem.observations.data.mirrors:
        free = _by_free_cameras(problem.residuals, solution.values, mirror)
        U, white = problem.whitened_at(solution, free)
        own, count = U.shape[1] - free.shape[1], free.shape[1]
        if int((free != 0.0).any(axis=1).sum()) - count < STEADYING:
            out[mirror] = None
            continue
        by_plane, by_cameras, errors = U[:, planes], U[:, own:], U[:, :own] @ may_err
        # Errors are known beforehand to be about nothing: a row of its own for each.
        known = np.eye(errors.shape[1])
        free_cameras = np.hstack([by_plane, by_cameras])
        out[mirror] = flatness_by(
            np.append(white, np.zeros(len(known))),
            _above(by_plane, errors, known),
            _above(free_cameras, errors, known),
            count - 3,
            len(white) - count,
        )
    return out


def _above(rows: NDArray, errors: NDArray, known: NDArray) -> NDArray:
    return np.block([[rows, errors], [np.zeros((len(known), rows.shape[1])), known]])


def _by_free_cameras(residuals: TreeResiduals, values: NDArray, mirror: str) -> NDArray:
    """Return derivatives of all residuals by what each camera sees elsewhere in a glass.

    By w and v of each of the C cameras that saw something in it. Shape (R, 6 C).
    """
    tree = residuals.parameters.tree_of(values)
    motion, plane = residuals.motion(tree), tree.mirror(mirror).plane
    seeing = [rows for rows in residuals.observations.sensors if rows.mirror == mirror]
    cameras = sorted({rows.sensor for rows in seeing})
    out = np.zeros((len(residuals.observations.row), 6 * len(cameras)))
    for rows in seeing:
        c = cameras.index(rows.sensor)
        sight = sight_of(tree, motion, residuals.run_of(rows))
        shift, p_WV = sight.shown.by_point @ sight.R_SW, reflect(plane, sight.p_WM)
        turn = -shift @ skew(p_WV - p_WV.mean(axis=0))
        both = np.concatenate([turn, shift], axis=2)
        out[rows.scalars, 6 * c : 6 * c + 6] = both.reshape(-1, 6)
    return out
