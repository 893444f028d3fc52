"""Whether a learned arm is the described robot: its size, and whether it is its mirror image."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.geometry.rotation import nearest_rotation
from nico_selfmodel.model.arm.chain import Chain
from nico_selfmodel.model.arm.dh_table import DhTable

_NEAR_RAD = np.radians(15.0)
"""Directions of axes must agree this well (rms), or the two arms cannot be compared."""
_LEAST_SIZE = 0.05
"""Distances between axes that a comparison of sizes needs [m]; less is uncertainty of the axes."""
_SAME_SIZE = 1.3
"""Ratio of sizes up to which a robot may differ from its description."""
_CLEARLY_LESS = 0.5
"""Ratio of what two readings of the zeros leave, from which on the second is taken."""
_LEFT_OVER = 0.3
"""Part of the distances between axes that may remain after scaling."""


def _signed_scale(nominal: Chain, learned: Chain) -> tuple[float, float] | None:
    """Return the scale that takes a described arm's axes to the learned ones, both at one zero.

    A mirror turns the sense of every rotation: with points p -> S p, directions go to -S d, so a
    mirrored arm is a rotated one whose distances are scaled by a negative number. Beside it stands
    the part of the distances between axes that it leaves; None where the axes do not tell: they
    meet in one point, are all parallel, or are not those of the described robot.
    """
    d = learned.directions
    rotation = nearest_rotation(d.T @ nominal.directions)
    turned = nominal.directions @ rotation.T
    apart = np.arccos(np.clip(np.sum(turned * d, axis=1), -1.0, 1.0))
    if np.linalg.svd(nominal.directions, compute_uv=False)[1] < 0.1:
        return None
    if np.sqrt(np.mean(apart**2)) > _NEAR_RAD:
        return None
    # A point of the described axis, scaled and moved, lies on the learned one.
    across = np.eye(3) - d[:, :, None] * d[:, None, :]
    points = nominal.points @ rotation.T
    columns = np.concatenate([across @ points[:, :, None], across], axis=2).reshape(-1, 4)
    target = (across @ learned.points[:, :, None]).ravel()
    solution, _, rank, _ = np.linalg.lstsq(columns, target, rcond=1e-9)
    scale = float(solution[0])
    reach, left = _reach(columns), float(np.linalg.norm(columns @ solution - target))
    if rank < 4 or reach < _LEAST_SIZE or left > _LEFT_OVER * abs(scale) * reach:
        return None
    return scale, left / (abs(scale) * reach)


def _reach(columns: NDArray) -> float:
    """Return how far described axes pass each other, whatever the place of the arm [m]."""
    moves = columns[:, 1:]
    return float(np.linalg.norm(columns[:, 0] - moves @ np.linalg.lstsq(moves, columns[:, 0])[0]))


def robot_reason(nominal: Chain, learned: DhTable, zero_known: NDArray) -> str | None:
    """Say when the measured points are a mirror image of the robot, or in another unit.

    Args:
        nominal: The described arm, at its zero.
        learned: The learned arm, at the same zero where that is known.
        zero_known: Joints whose encoders read the description's angles. Shape (n,).

    Returns:
        A sentence with what to do, or None.
    """
    found = []
    for sign in (1.0, -1.0):
        like = Chain(
            nominal.joints,
            nominal.directions,
            sign * nominal.points,
            nominal.markers,
            sign * nominal.p_WH_zero,
        )
        # An unknown zero is where theta is that of the description, or of its mirror image.
        theta = np.where(zero_known, learned.theta_zero, DhTable.from_chain(like).theta_zero)
        scale_and_rest = _signed_scale(nominal, replace(learned, theta_zero=theta).to_chain())
        if scale_and_rest is not None:
            found.append(scale_and_rest)
    if not found:
        return None
    scale, rest = found[0]
    if found[-1][1] < _CLEARLY_LESS * rest:
        scale = found[-1][0]
    if scale < 0.0:
        return (
            "the learned arm is a mirror image of the robot's description: the points are in "
            "left-handed coordinates; negate one of x, y, z (or exchange two of them) in all points"
        )
    if 1.0 / _SAME_SIZE <= scale <= _SAME_SIZE:
        return None
    return (
        f"the learned arm is {scale:.4g} times as large as the robot's description: check the unit "
        "of length of the points, and that this is the robot"
    )
