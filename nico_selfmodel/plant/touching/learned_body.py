"""What a robot has seen of its body, as what its arm must keep off."""

from nico_selfmodel.geometry.solids.ball_fit import fit_balls
from nico_selfmodel.geometry.solids.solid import Solid
from nico_selfmodel.model.shape.link_shape import LinkShape

_CLOSE, _LARGEST = 2e-3, 0.030
"""Of the balls that a surface lies on: within which it does, and their radius [m]."""


def seen_balls(shape: LinkShape) -> tuple[Solid, ...]:
    """Return balls that stand for all that was seen of a link; none if nothing was.

    Args:
        shape: The learned surface of the link.

    Returns:
        Balls in the link's frame that touch the surface from within.
    """
    mesh = shape.mesh
    told = shape.seen & mesh.normals.any(axis=1)  # a vertex of no triangle has no normal
    if not told.any():
        return ()
    return fit_balls(mesh.vertices[told], mesh.normals[told], _CLOSE, _LARGEST)
