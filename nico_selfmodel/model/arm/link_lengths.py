"""Lengths of the links of a paired arm, on which every way of writing it down agrees."""

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.model.arm.chain import Chain


def link_lengths(chain: Chain, marker: int = 0) -> tuple[float, float]:
    """Return the lengths of the links of an arm with paired joints at shoulder and elbow.

    The thesis' section 8.4.3. Each end is a foot of the common perpendicular of a pair of axes, on
    the axis that the link is fixed to, so that the lengths are those of every pose.

    Args:
        chain: An arm of four joints.
        marker: The tracked point at the end of the second link.

    Returns:
        Shoulder to elbow, and elbow to the tracked point [m].

    Raises:
        ValueError: If the chain has not four joints, or a pair of axes is parallel.
    """
    if len(chain.joints) != 4:
        raise ValueError(f"only a paired arm of 4 joints has two links, got {len(chain.joints)}")
    shoulder, upper, lower = _foot(chain, 1, 0), _foot(chain, 2, 3), _foot(chain, 3, 2)
    hand = chain.p_WH_zero[marker]
    return float(np.linalg.norm(upper - shoulder)), float(np.linalg.norm(hand - lower))


def _foot(chain: Chain, on: int, to: int) -> NDArray:
    """Return the point of one axis that is nearest to another. Shape (3,)."""
    a, b = chain.directions[on], chain.directions[to]
    across = np.cross(a, b)
    if np.linalg.norm(across) < 1e-3:
        raise ValueError(f"{chain.joints[on]} and {chain.joints[to]} are parallel: no pair")
    columns = np.stack([a, -b, across], axis=1)
    along = np.linalg.solve(columns, chain.points[to] - chain.points[on])[0]
    return chain.points[on] + along * a
