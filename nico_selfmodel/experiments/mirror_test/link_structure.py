"""The learned surface of one link beside the true one, and what judging any link takes."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.geometry.solids.solid import Solid
from nico_selfmodel.geometry.triangle_mesh import TriangleMesh
from nico_selfmodel.sessions.mirrors.own_shape import Surfaces

NEAR = 5e-3
"""What is seen is claimed if the learned surface passes so near [m]."""
SEEN = 300
"""Places of a link that are seen, and looked for in the learned surface."""


@dataclass(frozen=True, eq=False)
class LinkStructure:
    """The learned surface of one link beside the true one, before the left camera."""

    robot: int
    """Seed of the robot."""
    link: str
    """Name of the link."""
    mesh: TriangleMesh
    """As learned, in the left camera's frame."""
    off: NDArray
    """How far each vertex is outside of the true body [m]. Shape (V,)."""
    p_LT: NDArray
    """Where the true body is next to each vertex, to first order [m]. Shape (V, 3)."""
    sigma: NDArray
    """What the robot says it may be off by [m]. Shape (V,)."""
    strange: float
    """Share of vertices that are nearest to another link."""
    unseen: float
    """Share of vertices of which no camera saw the outside in any look."""
    covered: float
    """Share of the places seen, in the first mirror or directly, that the surface passes."""


def share(holds: NDArray) -> float:
    """Return the share of vertices of which something holds; 0 where there is none."""
    return float(np.mean(holds)) if len(holds) else 0.0


def posed(surfaces: Surfaces, X_FL: NDArray | None = None) -> tuple[list[Solid], NDArray]:
    """Return all solids before the left camera, and the link of each.

    Args:
        X_FL: Pose of the left camera in another frame, if they are wanted there. Shape (4, 4).
    """
    X_FL = np.eye(4) if X_FL is None else X_FL
    solids = [
        Solid(one.kind, one.size, X_FL @ X_LF @ one.X_FS)
        for surface, X_LF in surfaces.values()
        for one in surface.solids
    ]
    names = [link for link, (surface, _) in surfaces.items() for _ in surface.solids]
    return solids, np.array(names)
