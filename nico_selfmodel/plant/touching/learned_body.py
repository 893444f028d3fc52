"""What a robot has seen of its body, as what its arm must keep off."""

from typing import Any

from numpy.typing import NDArray
from pydrake.geometry import GeometryInstance, ProximityProperties, Sphere

from nico_selfmodel.geometry.solids.ball_fit import fit_balls
from nico_selfmodel.geometry.solids.solid import Solid
from nico_selfmodel.model.shape.link_shape import LinkShape
from nico_selfmodel.plant.kinematic_tree import rigid

NEARER = 3e-3
"""So much deeper than it was seen counts what must be kept off [m]. Distances are meant for the
description's collision shapes, which lie up to 8 mm below what is drawn; set on 1853 and 1857."""
_CLOSE, _LARGEST = 2e-3, 0.030
"""Of the balls that a surface lies on: within which it does, and their radius [m]."""


def seen_balls(shape: LinkShape) -> tuple[Solid, ...]:
    """Return balls that stand for all that was seen of a link; none if nothing was.

    Args:
        shape: The learned surface of the link.

    Returns:
        Balls in the link's frame, `NEARER` below the surface.
    """
    mesh = shape.mesh
    told = shape.seen & mesh.normals.any(axis=1)  # a vertex of no triangle has no normal
    if not told.any():
        return ()
    balls = fit_balls(mesh.vertices[told], mesh.normals[told], _CLOSE, _LARGEST)
    return tuple(
        Solid(one.kind, (one.size[0] - NEARER,) * 3, one.X_FS)
        for one in balls
        if one.size[0] > NEARER
    )


def add_balls(
    scene: Any, context: Any, source: Any, frame: Any, balls: tuple[Solid, ...], X_FG: NDArray
) -> list[Any]:
    """Let balls collide in a context of a scene graph.

    Args:
        scene: The scene graph.
        context: Its context.
        source: Whose geometry it is.
        frame: Frame that carries them.
        balls: In some frame G.
        X_FG: Pose of that in the frame. Shape (4, 4).

    Returns:
        Their ids.
    """
    found = []
    for k, ball in enumerate(balls):
        one = GeometryInstance(rigid(X_FG @ ball.X_FS), Sphere(ball.size[0]), f"seen_{k}")
        one.set_proximity_properties(ProximityProperties())
        found.append(scene.RegisterGeometry(context, source, frame, one))
    return found
