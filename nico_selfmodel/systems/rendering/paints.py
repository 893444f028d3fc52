"""The paints of a robot: what its description draws in one colour is of one paint."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pydrake.geometry import GeometryId, PerceptionProperties, RenderLabel, Rgba, Role, SceneGraph
from pydrake.systems.framework import Context

from nico_selfmodel.plant.model_in_plant import ModelInPlant

Color = tuple[float, float, float]
"""Red, green and blue, of 1."""
Painted = Sequence[tuple[GeometryId, Color]]
"""What is drawn in one colour, and that colour by the description."""
_DARKEST, _BRIGHTEST = 0.01, 1.0


def painted(scene_graph: SceneGraph, built: ModelInPlant) -> Painted:
    """Return all shapes of a robot that are of one colour."""
    plant, inspector, found = built.plant, scene_graph.model_inspector(), []
    for body in plant.GetBodyIndices(built.instance):
        frame = plant.GetBodyFrameIdIfExists(body)
        for geometry in [] if frame is None else inspector.GetGeometries(frame, Role.kPerception):
            properties: Any = inspector.GetPerceptionProperties(geometry)
            plain = properties.HasProperty("phong", "diffuse")
            if plain and not properties.HasProperty("phong", "diffuse_map"):
                color = properties.GetProperty("phong", "diffuse")
                found.append((geometry, (color.r(), color.g(), color.b())))
    return found


def repaint(
    scene_graph: SceneGraph,
    built: ModelInPlant,
    shapes: Painted,
    colors: Mapping[Color, Color],
    context: Context | None = None,
) -> None:
    """Let shapes have other colours.

    Args:
        scene_graph: Where the robot is drawn.
        shapes: Of `painted`.
        colors: Colour by the description -> new one; others stay.
        context: The scene graph's, if only there.
    """
    for geometry, color in shapes:
        if color in colors:
            _change(scene_graph, built, geometry, context, color=colors[color])


def tell_apart(
    scene_graph: SceneGraph, built: ModelInPlant, shapes: Painted, stride: int
) -> NDArray:
    """Let pictures of labels tell paints: a label is the link's, and `stride` a paint, from 1.

    Returns:
        The colours of all paints by the description. Shape (K, 3).
    """
    paints = list(dict.fromkeys(color for _, color in shapes))
    inspector = scene_graph.model_inspector()
    for geometry, color in shapes:
        properties = inspector.GetPerceptionProperties(geometry)
        link = int(properties.GetPropertyOrDefault("label", "id", RenderLabel(0)))
        label = link + stride * (1 + paints.index(color))
        _change(scene_graph, built, geometry, None, label=label)
    return np.array(paints, dtype=float).reshape(-1, 3)


def paint_otherwise(
    scene_graph: SceneGraph, built: ModelInPlant, sigma: float, rng: np.random.Generator
) -> None:
    """Let colours be as they may really be: nobody measures them for a description.

    Args:
        scene_graph: Where the robot is drawn.
        sigma: Standard deviation of each of red, green and blue, as a share.
    """
    shapes = painted(scene_graph, built)
    paints = list(dict.fromkeys(color for _, color in shapes))
    shares = np.exp(sigma * rng.standard_normal((len(paints), 3)))
    new = np.clip(np.array(paints).reshape(-1, 3) * shares, _DARKEST, _BRIGHTEST)
    colors = {old: (r, g, b) for old, (r, g, b) in zip(paints, new.tolist(), strict=True)}
    repaint(scene_graph, built, shapes, colors)


def _change(
    scene_graph: SceneGraph,
    built: ModelInPlant,
    geometry: GeometryId,
    context: Context | None,
    *,
    color: Color | None = None,
    label: int | None = None,
) -> None:
    """Give a shape another colour or label: Drake (1.51) takes them only with a new role."""
    where = () if context is None else (context,)
    # Only one of these is changed, and either from what it was at first: labels, then colours.
    properties = PerceptionProperties(
        scene_graph.model_inspector().GetPerceptionProperties(geometry)
    )
    if color is not None:
        properties.UpdateProperty("phong", "diffuse", Rgba(*color, 1.0))
    if label is not None:
        properties.UpdateProperty("label", "id", RenderLabel(label))
    source = built.plant.get_source_id()
    scene_graph.RemoveRole(*where, source, geometry, Role.kPerception)
    scene_graph.AssignRole(*where, source, geometry, properties)
