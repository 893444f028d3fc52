"""Sensors that are off alike in all that they see of one pose, as of another moment.

What is left of a pose, whitened by all that is shared through its joints, is independent of marker
to marker. Of n_k markers of pose k with mean m_k, d coordinates each, the ratio

    F = sum n_k |m_k|^2 / (d K)  /  (sum |r - m_k|^2 / (d sum (n_k - 1)))

is 1 (analysis of variance, Fisher 1925); where a sensor lags, shakes, or shows another pose, it is
larger, and standard deviations that count markers as independent are too small, by up to its root.
"""

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.dataset.body.sensors import CAMERA, SIGHTS
from nico_selfmodel.estimation.tree.tree_calibration import TreeCalibration

LEAST_RATIO = 4.0
"""F from which on a sensor is named: sigmas that are too small by up to two."""
_FEWEST_POSES = 20
"""Poses of two markers or more that are needed: chance makes F four in one of 1e5 of such."""


def sensors_off_at_once(calibration: TreeCalibration) -> list[str]:
    """Name sensors that are off alike in all that they see of one pose."""
    solution, seen = calibration.solution, calibration.train.observations
    white, words = solution.white_by_scalar(seen), list[str]()
    for rows in (rows for rows in seen.sensors if rows.kind in SIGHTS):
        left = white[rows.scalars].reshape(rows.measured.shape)[:, :3]
        counts = np.isfinite(left).all(axis=1)
        own, ratio, markers, poses = at_once(left[counts], rows.pose[counts])
        if ratio < LEAST_RATIO or poses < _FEWEST_POSES:
            continue
        own *= float(solution.noise.sensor[seen.noise_group[rows.first]])
        unit, scale = ("px", 1.0) if rows.kind == CAMERA else ("mm", 1e3)
        shared = scale * own * np.sqrt((ratio - 1.0) / markers)
        words.append(
            f"all that {rows.name!r} sees of a pose is off alike, by {shared:.2g} {unit}, and each "
            f"marker by {scale * own:.2g} {unit} besides: is it of the moment of the encoders' "
            f"readings, and did it stand still? Standard deviations are too small by up to a "
            f"factor of {np.sqrt(ratio):.1f}"
        )
    return words


def at_once(left: NDArray, pose: NDArray) -> tuple[float, float, float, int]:
    """Return how residuals of one pose hang together, of poses that have more than one.

    Args:
        left: Whitened residuals. Shape (N, d).
        pose: Of each. Shape (N,).

    Returns:
        Root mean square of what each has of its own, F, mean number of a pose, and how many poses.
        F is 1 where there is nothing to tell.
    """
    _, number, count = np.unique(pose, return_inverse=True, return_counts=True)
    mean = np.zeros((len(count), left.shape[1]))
    np.add.at(mean, number, left)
    mean /= np.maximum(count, 1)[:, None]
    many = count > 1
    if not many.any():
        return 0.0, 1.0, 0.0, 0
    alone = float(np.sum((left - mean[number])[many[number]] ** 2)) / float((count[many] - 1).sum())
    between = float(np.sum(count[many, None] * mean[many] ** 2)) / float(many.sum())
    own = float(np.sqrt(alone / left.shape[1]))
    return own, between / max(alone, 1e-12), float(count[many].mean()), int(many.sum())
