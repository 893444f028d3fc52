"""Wide cameras, boards shown to them all over the image, and what they see of these."""

import numpy as np

from nico_selfmodel.dataset.board_views import BoardViews
from nico_selfmodel.geometry.rotation import rotation_from_vector
from nico_selfmodel.geometry.transform import apply, transform
from nico_selfmodel.model.cameras.camera import Camera

SIZE = (1280, 960)
GRID = np.stack(np.meshgrid(np.arange(9.0), np.arange(6.0)), axis=-1).reshape(-1, 2)
P_GQ = 0.05 * np.column_stack([GRID, np.zeros(len(GRID))])
WIDEST = {"polynomial": 30.0, "rational": 45.0, "fisheye": 71.0}
"""How far off the axis boards stand [deg]."""


def wide_camera(kind, rng):
    """A camera with a lens of a kind; a fisheye sees 190 deg."""
    center = {"cx": 639.5 + rng.normal(0.0, 8.0), "cy": 479.5 + rng.normal(0.0, 8.0)}
    f = {"fisheye": 1280 / np.radians(190), "rational": 455.0, "polynomial": 850.0}[kind]
    f *= rng.uniform(0.95, 1.05)
    k = {
        "fisheye": rng.normal(0.0, [0.03, 0.01, 0.003, 0.0005]),
        "rational": [0.8 + 0.1 * rng.normal(), 0.12, 0.002, 1.1 + 0.1 * rng.normal(), 0.3, 0.02],
        "polynomial": [-0.28 + 0.02 * rng.normal(), 0.09, -0.004],
    }[kind]
    bends = {f"k{i + 1}": float(value) for i, value in enumerate(k)}
    return Camera(f, f * rng.uniform(0.998, 1.002), image_size=SIZE, lens=kind, **center, **bends)


def wide_views(cameras, rng, count=25, sigma=0.1):
    """Boards that all cameras see whole, with noise."""
    kept, kind = [], cameras[0].lens
    while len(kept) < count:
        off, way = rng.uniform(0.0, np.radians(WIDEST[kind])), rng.uniform(0.0, 2.0 * np.pi)
        z = np.array([np.sin(off) * np.cos(way), np.sin(off) * np.sin(way), np.cos(off)])
        x = np.cross([0.0, 1.0, 0.0], z)
        x /= np.linalg.norm(x)
        R = np.column_stack([x, np.cross(z, x), z]) @ rotation_from_vector(rng.normal(0.0, 0.35, 3))
        X = transform(R, z * rng.uniform(0.25, 0.7) - R @ P_GQ.mean(axis=0))
        pixels = np.hstack([camera.project(apply(X, P_GQ)) for camera in cameras])
        if (pixels >= 0.0).all() and (pixels <= np.tile(SIZE, len(cameras)) - 1.0).all():
            kept.append(pixels + sigma * rng.normal(size=pixels.shape))
    names = tuple(f"{i:02d}" for i in range(count))
    sides = ("left", "right")[: len(cameras)]
    return BoardViews(P_GQ, names, sides, np.array(kept), (SIZE,) * len(cameras))
