"""Markers and boards rendered with a known truth, and the faults of photographs.

Nothing of the package is used: a homography is written out, and a pixel is averaged over 5 x 5
hits. An integer pixel is its centre.
"""

from dataclasses import dataclass

import cv2
import numpy as np

CELL = 40  # texture pixels along a cell or a square
QUIET = 2  # cells of white around a marker
SQUARE = np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])
BLACK, WHITE = 40.0, 200.0


@dataclass(frozen=True, eq=False)
class Rendered:
    """A picture and where its points truly are."""

    image: np.ndarray
    points: np.ndarray
    center: np.ndarray


def project(H, points):
    """Map points by a homography."""
    mapped = np.column_stack([points, np.ones(len(points))]) @ H.T
    return mapped[:, :2] / mapped[:, 2:]


def random_view(rng, size, image_size, *, tilt=0.9, roll=np.pi, center=None):
    """Return a homography of the square [-1, 1]^2 into an image, as a tilted camera sees it.

    The square is about `size` pixels wide and lies whole within the image, or at `center`.
    """
    axis = rng.uniform(-np.pi, np.pi)
    turn = rng.uniform(0.0, tilt) * np.array([np.cos(axis), np.sin(axis), 0.0])
    tilted, _ = cv2.Rodrigues(turn)
    rolled, _ = cv2.Rodrigues(np.array([0.0, 0.0, rng.uniform(-roll, roll)]))
    R = tilted @ rolled
    focal, width, height = 500.0, *image_size
    free = np.array([width, height]) - 1.8 * size
    u, v = center or 0.9 * size + rng.uniform(0.0, 1.0, 2) * free
    to_pixels = np.array([[focal, 0, u], [0, focal, v], [0, 0, 1.0]])
    return to_pixels @ np.column_stack([R[:, :2], [0, 0, 2.0 * focal / size]])


def render_marker(dictionary, marker, H, rng, **photograph):
    """Render a marker whose black square [-1, 1]^2 lands where H says."""
    bits = dictionary.markerSize + 2
    pattern = cv2.aruco.generateImageMarker(dictionary, marker, bits) > 0
    texture = np.kron(np.pad(pattern, QUIET, constant_values=True), np.ones((CELL, CELL), bool))
    half = 0.5 * bits * CELL
    image = _photograph(texture, half, H, rng, **photograph)
    return Rendered(image, project(H, SQUARE), H[:2, 2] / H[2, 2])


def render_board(columns, rows, H, rng, **photograph):
    """Render a board of columns x rows inner corners; the longer side of its squares is [-1, 1].

    The first inner square is dark; `points` are the inner corners row by row.
    """
    parity = np.add.outer(np.arange(rows + 1), np.arange(columns + 1)) % 2
    squares = np.pad(np.kron(parity, np.ones((CELL, CELL))) > 0, CELL, constant_values=True)
    half = 0.5 * CELL * (max(columns, rows) + 1)
    image = _photograph(squares, half, H, rng, **photograph)
    u, v = np.meshgrid(np.arange(columns), np.arange(rows))
    corners = np.stack([u - 0.5 * (columns - 1), v - 0.5 * (rows - 1)], axis=-1).reshape(-1, 2)
    return Rendered(image, project(H, corners * CELL / half), H[:2, 2] / H[2, 2])


def _photograph(
    white, half, H, rng, *, image_size=(320, 240), blur=0.6, noise=2.0, background=110.0
):
    """Return what a camera sees of a texture; its middle is (0, 0), and `half` texels are 1."""
    texture = np.where(white, WHITE, BLACK).astype(np.float32)
    height, width = texture.shape
    from_texture = np.array([[1, 0, -0.5 * (width - 1)], [0, 1, -0.5 * (height - 1)], [0, 0, half]])
    s = 5
    finer = np.array([[s, 0, (s - 1) / 2], [0, s, (s - 1) / 2], [0, 0, 1.0]])
    size = (image_size[0] * s, image_size[1] * s)
    fine = cv2.warpPerspective(
        texture, finer @ H @ from_texture, size, flags=cv2.INTER_LINEAR, borderValue=background
    )
    image = cv2.resize(fine, image_size, interpolation=cv2.INTER_AREA)
    if blur:
        image = cv2.GaussianBlur(image, (0, 0), blur)
    image = image + rng.normal(0.0, noise, image.shape)
    gray = np.clip(np.rint(image), 0, 255).astype(np.uint8)
    return cv2.cvtColor(gray, cv2.COLOR_GRAY2BGR)
