"""Photographs of a chessboard drawn by ray casting: an oracle that shares no projection code."""

import cv2
import numpy as np

from nico_selfmodel.geometry.rotation import rotation_from_vector
from nico_selfmodel.geometry.transform import transform
from nico_selfmodel.model.cameras.camera import Camera
from nico_selfmodel.model.cameras.stereo_rig import StereoRig

COLUMNS, ROWS, SQUARE = 7, 5, 0.03
FINE = 3

SMALL_RIG = StereoRig(
    Camera(210.0, 211.0, 160.0, 118.0, (320, 240), k1=-0.2, k2=0.05),
    Camera(
        209.0, 208.5, 156.0, 121.0, (320, 240), k1=-0.19, k2=0.045,
        X_WC=transform(rotation_from_vector([0.01, -0.04, 0.015]), [0.07, 0.001, -0.002]),
    ),
)  # fmt: skip


def sight_lines(camera):
    """Return directions in the camera's frame of a fine grid of pixels. Shape (h, w, 3)."""
    width, height = camera.image_size
    fine = (np.arange(FINE) + 0.5) / FINE - 0.5
    u = (np.arange(width)[:, None] + fine).ravel()
    v = (np.arange(height)[:, None] + fine).ravel()
    grid = np.stack(np.meshgrid(u, v), axis=-1).reshape(-1, 2)
    ideal = camera.undistort(grid).reshape(len(v), len(u), 2)
    return np.concatenate([ideal, np.ones((*ideal.shape[:2], 1))], axis=2)


def drawn(camera, lines, X_WG, noise=1.0, rng=None):
    """Return a photograph of the board at X_WG, grey on grey with a white rim. (h, w) uint8."""
    X_CG = camera.X_CW @ X_WG
    normal, origin = X_CG[:3, 2], X_CG[:3, 3]
    depth = (origin @ normal) / (lines @ normal)
    on_board = (lines * depth[..., None] - origin) @ X_CG[:3, :2] / SQUARE
    x, y = np.moveaxis(on_board, -1, 0)
    inside = (x > -1) & (x < COLUMNS) & (y > -1) & (y < ROWS)
    rim = (x > -1.7) & (x < COLUMNS + 0.7) & (y > -1.7) & (y < ROWS + 0.7)
    dark = ((np.floor(x) + np.floor(y)) % 2 == 0) & inside
    light = np.where(dark, 30.0, np.where(rim, 225.0, 120.0))
    light = np.where(depth > 0.0, light, 120.0)
    h, w = light.shape
    image = light.reshape(h // FINE, FINE, w // FINE, FINE).mean(axis=(1, 3))
    if rng is not None:
        image = image + rng.normal(0.0, noise, image.shape)
    return np.clip(np.round(image), 0, 255).astype(np.uint8)


def attitudes(count, seed=0):
    """Return poses of the board that both cameras of `SMALL_RIG` see whole."""
    rng, found = np.random.default_rng(seed), []
    across, down = np.meshgrid([-1.7, COLUMNS + 0.7], [-1.7, ROWS + 0.7])
    rim = SQUARE * np.stack([across.ravel(), down.ravel(), np.zeros(4)], axis=1)
    center = 0.5 * SQUARE * np.array([COLUMNS - 1, ROWS - 1, 0.0])
    while len(found) < count:
        rotation = rotation_from_vector(rng.normal(0.0, 0.3, 3))
        p = np.array([*rng.uniform([-0.12, -0.1], [0.18, 0.1]), rng.uniform(0.35, 0.6)])
        X_WG = transform(rotation, p - rotation @ center)
        pixels = SMALL_RIG.project(rim @ rotation.T + X_WG[:3, 3])
        if (pixels > 3).all() and (pixels < np.array([316, 236] * 2)).all():
            found.append(X_WG)
    return found


def draw_pairs(folder, count=8, seed=0):
    """Write left and right photographs of the board into a folder."""
    rng = np.random.default_rng(seed)
    lines = [sight_lines(camera) for camera in SMALL_RIG.cameras]
    for i, X_WG in enumerate(attitudes(count, seed), start=1):
        for side, camera, sight in zip(("left", "right"), SMALL_RIG.cameras, lines, strict=True):
            image = drawn(camera, sight, X_WG, rng=rng)
            cv2.imwrite(str(folder / f"{side}{i:02d}.png"), image)
