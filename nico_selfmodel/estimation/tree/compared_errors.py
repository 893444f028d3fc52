"""What a body leaves of a recording, as results tell it: by kind, and what sets are compared by."""

from collections.abc import Iterable, Mapping

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.dataset.body.sensors import CAMERA, POINTS, POSES, TOUCHES
from nico_selfmodel.estimation.results.calibration_result import Errors
from nico_selfmodel.estimation.tree.forward.tree_residuals import TreeResiduals
from nico_selfmodel.estimation.tree.tree_errors import TreeErrors
from nico_selfmodel.estimation.tree.tree_noise import noise_named
from nico_selfmodel.estimation.tree.tree_observations import TURN_NOISE, TreeObservations
from nico_selfmodel.estimation.tree.tree_parameters import TreeParameters
from nico_selfmodel.model.tree.body_model import BodyModel
from nico_selfmodel.model.tree.body_tree import BodyTree

SPACE, IMAGES, TOUCHED = "mm", "px", "touch"
"""What errors are of, by the keys of `BodyModel.expected`: places, pixels, touches and
distances."""
COMPARED = (SPACE, IMAGES, TOUCHED)
"""What errors are compared by, the most telling first."""
RELATIVE = "relative"
"""Key of the median in units of usual errors."""
_KINDS = {SPACE: (POINTS, POSES), IMAGES: (CAMERA,), TOUCHED: TOUCHES}


def usual_errors(
    tree: BodyTree, seen: TreeObservations, noise: Mapping[str, float]
) -> NDArray | None:
    """Return how far off each observation is by noise alone, rms: by how far it is away, and what.

    Recordings of one part of the workspace can be held against those of another by it.

    Args:
        tree: The body.
        seen: What was measured of it.
        noise: Standard deviations of sensors and joints, by name.

    Returns:
        Of places of poses, by row of the table, shape (N,); None where noise is not known.
    """
    known = noise_named(noise, seen)
    if known is None or min(known.sensor) <= 0.0:
        return None
    parameters = TreeParameters(tree)
    linear = TreeResiduals(seen, parameters).linear(parameters.values_of(tree))
    variance = np.sum((linear.by_joint * known.joint) ** 2, axis=1)
    variance += known.sensor[seen.noise_group] ** 2
    of_turn = np.char.endswith(np.array(seen.noise_groups), TURN_NOISE)[seen.noise_group]
    return np.sqrt(seen.per_row(np.where(of_turn, 0.0, variance)))


def errors_of_tree(
    errors: TreeErrors,
    keep: NDArray | None = None,
    among: Iterable[str] = COMPARED,
    usual: NDArray | None = None,
) -> Errors:
    """Return errors in space where any were measured there, in the images, and by pose.

    Where nothing was seen those in space are by how much touches and distances are missed.

    Args:
        errors: What a body leaves.
        keep: Rows of the table that count. Boolean, shape (N,).
        among: What it may be compared by, of `COMPARED`, the most telling first.
        usual: See `usual_errors`: what is compared is in units of that, if given. Shape (N,).
    """
    distance = errors.by_row()
    keep = np.isfinite(distance) & (True if keep is None else keep)
    table = errors.observations.data.observations
    kind = np.array([s.kind for s in errors.observations.data.sensors])[table.sensor]
    of = {key: keep & np.isin(kind, kinds) for key, kinds in _KINDS.items()}
    there = [key for key in among if of[key].any()]
    key = there[0] if there else next((k for k in COMPARED if of[k].any()), SPACE)
    in_images = of[IMAGES]
    in_space = of[TOUCHED] if errors.in_space == TOUCHES else of[SPACE]
    pose = np.append(errors.observations.data.pose, -1)[table.pose]
    compared, relative_to = _by_pose(distance, pose, of[key]) if there else np.zeros(0), None
    if usual is not None and len(compared):
        median = float(np.median(compared))
        compared = _by_pose(distance / usual, pose, of[key])
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
    """Return errors of new data by what a body says to expect.

    Args:
        model: The body.
        errors: What it leaves.
    """
    among = [key for key in COMPARED if key in model.expected]
    found = errors_of_tree(errors, None, among)
    if RELATIVE not in model.expected.get(found.compared_by, {}):
        return found
    usual = usual_errors(model.tree, errors.observations, model.noise)
    return found if usual is None else errors_of_tree(errors, None, among, usual)


def _by_pose(distance: NDArray, pose: NDArray, rows: NDArray) -> NDArray:
    """Return the mean error of each pose of some rows. Shape (K,)."""
    of = np.unique(pose[rows], return_inverse=True)[1]
    return np.asarray(np.bincount(of, distance[rows]) / np.maximum(np.bincount(of), 1))


def expected_errors(
    errors: TreeErrors, keep: NDArray, usual: NDArray | None
) -> dict[str, dict[str, float]]:
    """Return the errors that new poses should show, by what they are of.

    Args:
        errors: Of poses left out.
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
    return found
