"""What a body leaves of a recording, as results tell it: by kind, and what sets are compared by."""

from collections.abc import Iterable, Mapping

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.dataset.body.sensors import CAMERA, POINTS, POSES, TOUCHES
from nico_selfmodel.estimation.results.calibration_result import Errors
from nico_selfmodel.estimation.results.verdict import outliers_are_many
from nico_selfmodel.estimation.tree.forward.tree_linear import TreeLinear
from nico_selfmodel.estimation.tree.forward.tree_residuals import TreeResiduals
from nico_selfmodel.estimation.tree.noise.finer_noise import TURN_NOISE
from nico_selfmodel.estimation.tree.tree_errors import TreeErrors
from nico_selfmodel.estimation.tree.tree_noise import noise_named
from nico_selfmodel.estimation.tree.tree_observations import TreeObservations
from nico_selfmodel.estimation.tree.tree_parameters import TreeParameters
from nico_selfmodel.estimation.tree.tree_solution import TreeNoise
from nico_selfmodel.model.tree.body_model import BodyModel
from nico_selfmodel.model.tree.body_tree import BodyTree
from nico_selfmodel.optimization.robust_solve import OUTLIER_AT

SPACE, IMAGES, TOUCHED = "mm", "px", "touch"
"""What errors are of, by the keys of `BodyModel.expected`: places, pixels, touches and
distances."""
COMPARED = (SPACE, IMAGES, TOUCHED)
"""What errors are compared by, the most telling first."""
RELATIVE, RELATIVE_TAIL = "relative", "relative_p90"
"""Keys of the median, and of what one in ten passes, in units of usual errors."""
_BESIDE = 4
"""Observations of a marker before and after one that tell whether it is off alone."""
_KINDS = {SPACE: (POINTS, POSES), IMAGES: (CAMERA,), TOUCHED: TOUCHES}


def usual_errors(
    tree: BodyTree, seen: TreeObservations, noise: Mapping[str, float]
) -> NDArray | None:
    """Return how far off each observation is by noise alone, rms: by how far it is away, and what.

    Recordings of one part of the workspace can be held against those of another by it.

    Args:
        noise: Standard deviations of sensors and joints, by name.

    Returns:
        Of places of poses, by row of the table, shape (N,); None where noise is not known, or
        boards move freely.
    """
    known = None if seen.data.free_joints else noise_named(noise, seen)
    if known is None or min(known.sensor) <= 0.0:
        return None
    parameters = TreeParameters(tree)
    linear = TreeResiduals(seen, parameters).linear(parameters.values_of(tree))
    return usual_by(linear, known, seen)


def usual_by(linear: TreeLinear, noise: TreeNoise, seen: TreeObservations) -> NDArray:
    """Return the same by derivatives that are known. Shape (N,)."""
    variance = np.sum((linear.by_joint * noise.joint) ** 2, axis=1)
    variance += noise.sensor[seen.noise_group] ** 2
    of_turn = np.char.endswith(np.array(seen.noise_groups), TURN_NOISE)[seen.noise_group]
    return np.sqrt(seen.per_row(np.where(of_turn, 0.0, variance)))


def alone_off(errors: TreeErrors, usual: NDArray | None) -> NDArray:
    """Return observations that are off on their own, as wrong labels are. Boolean, (N,).

    They are `unexplained`, and further off than most of their pose is.

    Args:
        usual: See `usual_errors`; nothing is off where that is not known. Shape (N,).
    """
    return _off(errors, usual, on_its_own=True)


def unexplained(errors: TreeErrors, usual: NDArray | None) -> NDArray:
    """Return observations that no noise explains, on their own or with their pose. Boolean, (N,).

    They are further off than noise explains, and than most of what was seen of their marker before
    and after; and they are no more than a training may have of them, of all and of what each sensor
    saw: one that turned away is off in all that it sees.

    Args:
        usual: See `usual_errors`; nothing is off where that is not known. Shape (N,).
    """
    return _off(errors, usual, on_its_own=False)


def _off(errors: TreeErrors, usual: NDArray | None, on_its_own: bool) -> NDArray:
    """Return what is `unexplained`, of its pose alone if asked for that."""
    table = errors.observations.data.observations
    off = np.zeros(len(table), dtype=bool)
    if usual is None:
        return off
    far = errors.by_row()
    told = np.flatnonzero(np.isfinite(far))
    far, pose, marker = far[told] / usual[told], table.pose[told], table.marker[told]
    about = np.maximum(1.0, median_around(far, pose, marker))
    if on_its_own:
        about = np.maximum(about, _median_of_pose(far, pose))
    off[told] = far > OUTLIER_AT * about
    for own in (np.ones_like(off), *(table.sensor == s for s in np.unique(table.sensor[off]))):
        if outliers_are_many(off[own]) is not None:
            off[own] = False
    return off


def _median_of_pose(values: NDArray, pose: NDArray) -> NDArray:
    """Return the median of the values of the same pose, the upper one of two. Shape (N,)."""
    _, of, counts = np.unique(pose, return_inverse=True, return_counts=True)
    middle = np.cumsum(counts) - counts + counts // 2
    return np.asarray(values[np.lexsort((values, of))][middle][of])


def median_around(values: NDArray, pose: NDArray, marker: NDArray) -> NDArray:
    """Return the median of what was seen of the same marker before and after. Shape (N,)."""
    order = np.lexsort((pose, marker))
    at = np.arange(len(order))[:, None] + np.arange(-_BESIDE, _BESIDE + 1)
    inside = np.clip(at, 0, max(len(order) - 1, 0))
    near, same = values[order][inside], marker[order][inside] == marker[order][:, None]
    out = np.empty(len(order))
    out[order] = np.nanmedian(np.where(same & (at == inside), near, np.nan), axis=1)
    return out


def errors_of_tree(
    errors: TreeErrors,
    keep: NDArray | None = None,
    among: Iterable[str] = COMPARED,
    usual: NDArray | None = None,
) -> Errors:
    """Return errors in space where any were measured there, in the images, and by pose.

    Where nothing was seen those in space are by how much touches and distances are missed.

    Args:
        keep: Rows of the table that count. Boolean, shape (N,).
        among: What it may be compared by, of `COMPARED`, the most telling first; where nothing of
            that was measured, nothing is compared.
        usual: See `usual_errors`: what is compared is in units of that, if given, and without what
            is `alone_off`. Shape (N,).
    """
    distance = errors.by_row()
    keep = np.isfinite(distance) & (True if keep is None else keep)
    data = errors.observations.data
    table = data.observations
    kind = np.array([s.kind for s in data.sensors])[table.sensor]
    of = {key: keep & np.isin(kind, kinds) for key, kinds in _KINDS.items()}
    sound = ~alone_off(errors, usual)
    there = [key for key in among if of[key].any()]
    key = there[0] if there else next((k for k in COMPARED if of[k].any()), SPACE)
    in_images = of[IMAGES]
    in_space = of[TOUCHED] if errors.in_space == TOUCHES else of[SPACE]
    pose = np.append(data.pose, -1)[table.pose]
    rows, relative_to = of[key] & sound, None
    # What moves freely is where each pose itself says: it tells nothing of new ones.
    steady = rows & ~np.isin(data.seen_on, data.free_joints)
    rows = steady if steady.any() else rows
    compared = _by_pose(distance, pose, rows) if there else np.zeros(0)
    if usual is not None and len(compared):
        median = float(np.median(compared))
        compared = _by_pose(distance / usual, pose, rows)
        relative_to = median / max(float(np.median(compared)), np.finfo(float).tiny)
    return Errors(
        distance[in_space] if in_space.any() else None,
        distance[in_images] if in_images.any() else None,
        int((in_space | in_images).sum()),
        len(np.unique(pose[in_space | in_images])),
        compared,
        IMAGES if key == IMAGES else SPACE,
        key,
        relative_to,
    )


def errors_beside_training(model: BodyModel, errors: TreeErrors) -> Errors:
    """Return errors of new data by what a body says to expect."""
    return _beside(model, errors, [key for key in COMPARED if key in model.expected])


def other_errors_beside_training(
    model: BodyModel, errors: TreeErrors, first: Errors
) -> tuple[Errors, ...]:
    """Return the same by all else that new data have, and a body says to expect.

    A camera that moved leaves places of a tracker where they are.

    Args:
        first: What `errors_beside_training` returns.
    """
    rest = [key for key in COMPARED if key in model.expected and key != first.compared_by]
    found = [_beside(model, errors, [key]) for key in rest]
    return tuple(e for key, e in zip(rest, found, strict=True) if e.compared_by == key)


def _beside(model: BodyModel, errors: TreeErrors, among: Iterable[str]) -> Errors:
    """Return errors by one of some kinds, in units of usual ones where they are expected so."""
    found = errors_of_tree(errors, None, among)
    if RELATIVE not in model.expected.get(found.compared_by, {}):
        return found
    usual = usual_errors(model.tree, errors.observations, model.noise)
    return found if usual is None else errors_of_tree(errors, None, among, usual)


def held_beside_crossed(
    held: TreeErrors,
    crossed: TreeErrors,
    inliers: NDArray,
    usual: tuple[NDArray | None, NDArray | None],
    first: str,
) -> tuple[tuple[Errors, Errors], ...]:
    """Return held-out errors and those of cross-validation by all kinds but the first.

    Args:
        inliers: Rows of the training that count. Boolean, shape (N,).
        usual: See `usual_errors`: of both, or neither.
        first: What the first are compared by.
    """
    pairs = []
    for key in COMPARED:
        if key == first:
            continue
        test = errors_of_tree(held, None, (key,), usual[0])
        train = errors_of_tree(crossed, inliers, (key,), usual[1])
        if len(test.compared) and len(train.compared):
            pairs.append((test, train))
    return tuple(pairs)


def _by_pose(distance: NDArray, pose: NDArray, rows: NDArray) -> NDArray:
    """Return the mean error of each pose of some rows. Shape (K,)."""
    of = np.unique(pose[rows], return_inverse=True)[1]
    return np.asarray(np.bincount(of, distance[rows]) / np.maximum(np.bincount(of), 1))


def expected_errors(
    errors: TreeErrors, keep: NDArray, usual: NDArray | None
) -> dict[str, dict[str, float]]:
    """Return the errors that new poses should show, by what they are of.

    Args:
        keep: Rows of the table that count. Boolean, shape (N,).
        usual: See `usual_errors`. Shape (N,).
    """
    found = {}
    for key in COMPARED:
        plain = errors_of_tree(errors, keep, (key,)).compared
        if not len(plain):
            continue
        found[key] = {"median": float(np.median(plain)), "n": float(len(plain))}
        if usual is not None:
            beside = errors_of_tree(errors, keep, (key,), usual).compared
            found[key][RELATIVE] = float(np.median(beside))
            found[key][RELATIVE_TAIL] = float(np.quantile(beside, 0.9))
    return found
