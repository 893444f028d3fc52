"""Where on its axis each joint of a learned arm is drawn, and how long the arm is.

Measured points tell lines, not where along them a joint sits. The joints are put where the arm is
shortest: on the shortest path that starts at the first axis, touches every axis in turn and ends
at the hand. For an arm built of links between joints that is the arm itself.
"""

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.model.arm.chain import Chain

_ROUNDS = 60


def joint_points(chain: Chain, marker: int = 0) -> NDArray:
    """Return a point on each axis, at the zero configuration.

    Args:
        marker: Index of the tracked point at which the path ends.

    Returns:
        Points of the shortest path [m], in the middle where it may slide. Shape (n, 3).
    """
    hand = chain.p_WH_zero[marker]
    points = _nearest_path(chain, hand, np.ones(len(chain.joints)))
    # A floor on the lengths keeps the weights finite where axes meet.
    floor = 1e-4 * max(float(np.linalg.norm(np.ptp(chain.points, axis=0))), 1e-3)
    for _ in range(_ROUNDS):
        lengths = np.maximum(_lengths(points, hand), floor)
        points = _nearest_path(chain, hand, 1.0 / lengths)
    return points


def arm_length(chain: Chain, marker: int = 0) -> float:
    """Return the length of the shortest path from the first axis over all axes to the hand [m].

    It is the same in every pose, and the sum of the link lengths where axes meet at right angles
    to the links, as the thesis counts its 242.482 mm.

    Args:
        marker: Index of the tracked point.
    """
    return float(_lengths(joint_points(chain, marker), chain.p_WH_zero[marker]).sum())


def _nearest_path(chain: Chain, hand: NDArray, weights: NDArray) -> NDArray:
    """Minimise the weighted squared lengths of the path's pieces over positions on the axes."""
    n = len(chain.joints)
    design, right = np.zeros((3 * n, n)), np.zeros(3 * n)
    ends = [*chain.points[1:], hand]
    for i in range(n):
        rows, root = slice(3 * i, 3 * i + 3), np.sqrt(weights[i])
        design[rows, i] = root * chain.directions[i]
        if i + 1 < n:
            design[rows, i + 1] = -root * chain.directions[i + 1]
        right[rows] = root * (ends[i] - chain.points[i])
    along = np.linalg.lstsq(design, right, rcond=None)[0]
    return chain.points + along[:, None] * chain.directions


def _lengths(points: NDArray, hand: NDArray) -> NDArray:
    """Return the lengths of the path's pieces [m]. Shape (n,)."""
    return np.linalg.norm(np.diff(np.concatenate([points, hand[None]]), axis=0), axis=1)
