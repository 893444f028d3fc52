"""One item of every kind, for tests of files and viewers."""

import numpy as np

from nico_selfmodel.geometry.rotation import rotation_from_rpy
from nico_selfmodel.geometry.transform import transform
from nico_selfmodel.viz.figures.photographs import jpeg
from nico_selfmodel.viz.scene.scene_items import (
    Box,
    Capsule,
    Cylinder,
    Ellipsoid,
    Item,
    Markers,
    Needles,
    Picture,
    Segments,
    Surface,
    Triad,
    Tube,
)

BLUE = (0.1, 0.3, 0.9, 1.0)
GLASS = (0.9, 0.3, 0.1, 0.4)


def every_item() -> tuple[Item, ...]:
    rng = np.random.default_rng(0)
    a, b = rng.standard_normal((2, 5, 3))
    pose = transform(rotation_from_rpy(0.3, 0.2, 0.1), [0.1, 0.2, 1.0 / 3.0])
    colors = rng.random((5, 3))
    photo = jpeg(rng.integers(0, 255, (6, 8, 3), dtype=np.uint8))
    return (
        Markers(path="points/coloured", color=BLUE, centers=a, radius=0.1, colors=colors),
        Markers(path="points/plain", color=GLASS, centers=b, radius=0.1, shape="diamond"),
        Needles(path="needles", color=BLUE, starts=a, ends=b, radius=0.02, colors=colors),
        Segments(path="floor/grid", color=GLASS, starts=a, ends=b),
        Tube(path="wire", color=BLUE, points=a, radius=0.02, closed=True),
        Box(path="arm/box", color=BLUE, X_WI=pose, sides=np.array([0.1, 0.2, 0.3])),
        Cylinder(path="arm/cylinder", color=GLASS, X_WI=pose, radius=0.1, length=0.4),
        Capsule(path="arm/capsule", color=BLUE, X_WI=pose, radius=0.1, length=0.4),
        Ellipsoid(path="arm/ball", color=GLASS, X_WI=pose, radii=np.array([0.1, 0.2, 0.3])),
        Triad(path="arm/frame", color=BLUE, X_WI=pose, length=0.3, radius=0.01),
        Surface(path="plane", color=GLASS, vertices=a, faces=[[0, 1, 2], [2, 3, 4]]),
        Surface(path="skin", color=BLUE, vertices=b, faces=[[0, 1, 2]], colors=colors),
        Picture(path="cameras/image", color=BLUE, X_WI=pose, width=0.4, height=0.3, image=photo),
    )
