"""The weight of an arm of which only the geometry is known: uniform rods from axis to axis.

Rods join the feet c_i of the axes, from the tracked points' middle backwards, each foot the nearest
to the next, so that they stay where they are on their links however the arm moves. With weights m_j
by length, one in all, and M_j of all beyond link j: l_j = (m_j / 2 + M_j) (c_{j+1} - c_j).
"""

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.model.arm.dh_table import DhTable


def uniform_rods(table: DhTable) -> tuple[NDArray, NDArray]:
    """Return the loads and pivots of a `Bending`.

    Args:
        table: The arm.

    Returns:
        First moments in the frame after each row, shape (n, 3), and the places of the feet along
        their axes, shape (n,) [m].
    """
    frames = table.frames(np.zeros(len(table.joints)))
    o, z = frames[:-1, :3, 3], frames[:-1, :3, 2]
    feet = [frames[-1, :3, :3] @ table.p_NH.mean(axis=0) + frames[-1, :3, 3]]
    for origin, axis in zip(o[::-1], z[::-1], strict=True):
        feet.append(origin + axis * (axis @ (feet[-1] - origin)))
    c = np.stack(feet[::-1])
    rod = np.diff(c, axis=0)
    length = np.linalg.norm(rod, axis=1)
    weight = length / max(float(length.sum()), np.finfo(float).tiny)
    beyond = weight[::-1].cumsum()[::-1] - weight
    moment = (0.5 * weight + beyond)[:, None] * rod
    loads = (np.swapaxes(frames[1:, :3, :3], 1, 2) @ moment[:, :, None])[:, :, 0]
    return loads, np.sum((c[:-1] - o) * z, axis=1)
