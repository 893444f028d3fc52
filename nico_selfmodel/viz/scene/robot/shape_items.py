"""The outer shape of links as it was learned, in the colours in which it was seen."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.geometry.transform import apply
from nico_selfmodel.model.shape.link_shape import BodyShape, LinkShape
from nico_selfmodel.viz.scene.scene import LegendEntry, Scene, path_names
from nico_selfmodel.viz.scene.scene_items import Surface
from nico_selfmodel.viz.scene.surroundings import camera_on, floor_items

NEVER_SEEN = (0.36, 0.38, 0.40)
"""Red, green and blue of vertices that no picture shows well enough."""
_WHITE = (1.0, 1.0, 1.0, 1.0)


def with_shape(scene: Scene, shape: BodyShape, X_SW: NDArray) -> Scene:
    """Return a scene in which links stand as they were seen, in place of as they are described.

    Args:
        scene: Of an arm or body, with or without its robot around it.
        X_SW: Pose of the self-model's world in the scene. Shape (4, 4).
    """
    described = {f"robot/{name}" for name in path_names(shape.links)}
    kept = [item for item in scene.items if "/".join(item.path.split("/")[:2]) not in described]
    return replace(
        scene,
        items=(*kept, *shape_items(shape, X_SW)),
        legend=(*scene.legend, *_shape_legend(shape)),
    )


def shape_scene(title: str, shape: BodyShape, X_SW: NDArray, front: NDArray) -> Scene:
    """Return learned surfaces alone, seen from the front.

    Args:
        X_SW: Pose of the self-model's world in the scene. Shape (4, 4).
        front: Where the body faces, in the scene. Shape (3,).
    """
    items = shape_items(shape, X_SW)
    points = np.concatenate([apply(one.X_WI, one.vertices) for one in items])
    grid, *_ = floor_items(points, 1.0)
    return Scene(title, (grid, *items), camera_on(points, front), tuple(_shape_legend(shape)))


def shape_items(shape: BodyShape, X_SW: NDArray) -> list[Surface]:
    """Return learned surfaces where they stood when they were seen.

    Args:
        X_SW: Pose of the self-model's world in the scene. Shape (4, 4).

    Returns:
        Items under `shape`, by link; links of which there is no triangle are left out.
    """
    return [
        Surface(
            path=f"shape/{name}",
            color=_WHITE,
            X_WI=X_SW @ shape.X_WF[link],
            vertices=own.mesh.vertices,
            faces=own.mesh.triangles,
            colors=_colors(own),
        )
        for name, (link, own) in zip(path_names(shape.links), shape.links.items(), strict=True)
        if len(own.mesh.triangles)
    ]


def _shape_legend(shape: BodyShape) -> list[LegendEntry]:
    """Return what the surfaces and their grey parts are."""
    seen = np.concatenate([own.colors[own.seen] for own in shape.links.values()])
    apart = np.linalg.norm(seen - NEVER_SEEN, axis=1)
    # Of a grey body what is least like the grey of what was never seen tells the two entries apart.
    told = seen[apart >= np.quantile(apart, 0.9)] if len(seen) else np.array([NEVER_SEEN])
    red, green, blue = np.median(told, axis=0)
    links = " and ".join(shape.links)
    return [
        LegendEntry(f"{links} as learned, in the colours seen", (red, green, blue, 1.0)),
        LegendEntry(f"parts of {links} that were never seen", (*NEVER_SEEN, 1.0)),
    ]


def _colors(shape: LinkShape) -> NDArray:
    return np.where(shape.seen[:, None], shape.colors, NEVER_SEEN)
