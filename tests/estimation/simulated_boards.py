"""Nico's wide cameras as they are, the boards shown to them, and their pictures of these."""

from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from nico_selfmodel.dataset.board_views import BoardViews
from nico_selfmodel.geometry.rotation import rotation_from_vector
from nico_selfmodel.geometry.transform import apply, transform
from nico_selfmodel.model.cameras.camera import Camera
from nico_selfmodel.model.cameras.stereo_rig import StereoRig

SIZE = (640, 480)
SQUARE = 0.028
GRID = np.stack(np.meshgrid(np.arange(9.0), np.arange(6.0)), axis=-1).reshape(-1, 2)
P_GQ = SQUARE * np.column_stack([GRID, np.zeros(len(GRID))])
RIG = StereoRig(
    Camera(381.0, 383.0, 326.0, 233.0, SIZE, k1=-0.28, k2=0.09, k3=-0.012),
    Camera(
        379.0,
        380.5,
        315.0,
        244.0,
        SIZE,
        k1=-0.27,
        k2=0.085,
        k3=-0.011,
        X_WC=transform(rotation_from_vector([0.01, -0.03, 0.02]), [0.07, 0.001, -0.002]),
    ),
)
"""Two cameras that differ; the left one stands at the world."""
BEFORE_BOTH = ([-0.12, -0.1, 0.22], [0.15, 0.1, 0.45])
TRUTH = dict(zip(RIG.names, RIG.values, strict=True))


def boards(
    count: int,
    seed: int = 0,
    tilt: float = 0.35,
    rig: StereoRig = RIG,
    between: tuple[ArrayLike, ArrayLike] = BEFORE_BOTH,
) -> NDArray:
    """Return poses of boards that both cameras see whole. Shape (V, 4, 4).

    Args:
        count: How many, V.
        seed: Of their places.
        tilt: Spread of their rotation vectors [rad].
        rig: The cameras.
        between: Corners of the box in which their middles are [m].
    """
    rng, found = np.random.default_rng(seed), []
    while len(found) < count:
        turn = rotation_from_vector(rng.normal(0.0, 1.0, 3) * tilt)
        middle = rng.uniform(*between)
        X_LG = transform(turn, middle - turn @ P_GQ.mean(axis=0))
        pixels = rig.project(apply(X_LG, P_GQ))
        if ((pixels >= 0.0) & (pixels <= np.tile(SIZE, 2) - 1.0)).all():
            found.append(X_LG)
    return np.array(found)


def pictures(X_LG: NDArray, sigma: float = 0.0, seed: int = 0, rig: StereoRig = RIG) -> BoardViews:
    """Return what the cameras see of boards, with noise [px]."""
    pixels = np.array([rig.project(apply(X, P_GQ)) for X in X_LG])
    noise = np.random.default_rng((seed, 3)).normal(0.0, sigma, pixels.shape)
    names = tuple(f"{v:02d}" for v in range(len(X_LG)))
    return BoardViews(P_GQ, names, ("left", "right"), pixels + noise, (SIZE, SIZE))


def changed(views: BoardViews, row: int, shift: NDArray | float) -> BoardViews:
    """Return the views with the corners of one of them moved [px]."""
    pixels = views.pixels.copy()
    pixels[row] += shift
    return replace(views, pixels=pixels)


def unseen(views: BoardViews, *parts: tuple) -> BoardViews:
    """Return the views without what some index expressions of the pixels pick."""
    pixels = views.pixels.copy()
    for part in parts:
        pixels[part] = np.nan
    return replace(views, pixels=pixels)


LEFT, RIGHT = slice(0, 2), slice(2, 4)
"""Pixel columns of each camera."""
