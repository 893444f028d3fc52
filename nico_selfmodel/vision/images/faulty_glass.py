"""What a bent or dirty mirror does to the picture that a flat and clean one shows.

Both work on the picture of the reflected twin (`mirror_glass`), of which each pixel is a place of
the glass.
"""

import cv2
import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.vision.images.mirror_glass import GlassInView

_STEPS = 4
"""Times a bent line of sight is followed to where it meets what the flat mirror shows."""
_FARTHEST = 5.0
"""Where what is nowhere is taken to be [m]."""
_CELL = 0.005
"""Side of a pixel of stains on the glass [m]."""
_STAIN = 2.0
"""Standard deviation of the blur that makes stains of noise, in their pixels."""
_GREY = 80.0
"""Grey level of dirt."""


def bent_picture(picture: NDArray, depth: NDArray, glass: GlassInView, radius: float) -> NDArray:
    """Return what the twin's picture becomes where the glass is a part of a sphere.

    With o = (0, 0, radius) the sphere's centre in the frame M of the glass, which touches its
    middle, c the camera and d = g - c its line of sight to a point g of the sphere,

        r = d - 2 (d . n) n,    n = (g - o) / radius

    is the reflected line. It is followed to where it meets what the twin, which sees the same world
    along straight lines through the flat glass, has in view: a point at a depth t of the twin is
    at z = D - t of M, with D the distance of both from the glass.

    Args:
        picture: The twin's, of the flat glass. Shape (h, w, channels).
        depth: Along its optical axis, inf where nothing is [m]. Shape (h, w).
        glass: Of which it is the twin.
        radius: Of curvature [m], positive where it bulges towards the camera.

    Returns:
        A picture of the same shape; its border where nothing else is known.
    """
    D, c = glass.distance, glass.center
    g = glass.places(depth.shape)
    t = np.where(np.isfinite(depth), depth, _FARTHEST).astype(np.float32)
    at, r = _reflected(g, c, radius)
    pixels = glass.pixels(g)
    for _ in range(_STEPS):
        here = picture_at(t, pixels, cv2.INTER_NEAREST)
        # Where the line is at that depth, and which place of the flat glass shows that.
        way = (D - here - at[..., 2]) / r[..., 2]
        q = at[..., :2] + way[..., None] * r[..., :2]
        pixels = glass.pixels(c[:2] + (q - c[:2]) * (D / here)[..., None])
    return picture_at(picture, pixels)


def _reflected(g: NDArray, c: NDArray, radius: float) -> tuple[NDArray, NDArray]:
    """Return where lines of sight through places of the plane meet the sphere, and go from there.

    Args:
        g: Places of the plane z = 0 [m]. Shape (h, w, 2).
        c: The camera [m]. Shape (3,).
        radius: Of the sphere [m].

    Returns:
        Points of the sphere [m] and directions. Shape (h, w, 3) each.
    """
    d = np.concatenate([g - c[:2], np.full((*g.shape[:2], 1), -c[2])], axis=2)
    # |c + s d - o|^2 = radius^2, the root that is the plane's (s = 1) for a large radius.
    from_o = c - [0.0, 0.0, radius]
    a, b = np.sum(d * d, axis=2), d @ from_o
    root = np.sqrt(np.maximum(b * b - a * (from_o @ from_o - radius**2), 0.0))
    s = (-b - np.sign(radius) * root) / a
    at = c + s[..., None] * d
    n = (at - [0.0, 0.0, radius]) / radius
    return at, d - 2.0 * np.sum(d * n, axis=2)[..., None] * n


def stained(picture: NDArray, glass: GlassInView, stains: NDArray, share: float) -> NDArray:
    """Return the twin's picture through stains.

    Args:
        picture: The twin's. Shape (h, w, channels).
        glass: Of which it is the twin.
        stains: How thick they lie, of the thickest (`stains_on`). Shape (h', w').
        share: What the thickest show of themselves.
    """
    size = np.array(stains.shape[::-1])
    places = glass.places(picture.shape[:2]) / _CELL + 0.5 * (size - 1.0)
    thick = share * picture_at(stains, places.astype(np.float32))
    mixed = picture * (1.0 - thick[..., None]) + _GREY * thick[..., None]
    return np.rint(mixed).astype(np.uint8)


def picture_at(picture: NDArray, pixels: NDArray, how: int = cv2.INTER_LINEAR) -> NDArray:
    """Return what a picture shows at pixels, its border beyond it.

    Args:
        picture: Shape (h, w) or (h, w, channels).
        pixels: Of the middle of the first pixel 0, 32 bits [px]. Shape (h', w', 2).
        how: OpenCV's interpolation.
    """
    u, v = np.moveaxis(pixels, -1, 0)
    return cv2.remap(picture, u, v, how, borderMode=cv2.BORDER_REPLICATE)


def stains_on(size: tuple[float, float], seed: int = 0) -> NDArray:
    """Return stains of some centimetres all over a glass, the same for the same seed.

    Args:
        size: Width and height of the glass [m].
        seed: Which stains.

    Returns:
        How thick they lie, of the thickest. Shape (h, w).
    """
    width, height = (max(2, round(side / _CELL)) for side in size)
    noise = np.random.default_rng(seed).normal(size=(height, width)).astype(np.float32)
    smooth = cv2.GaussianBlur(noise, (0, 0), _STAIN, borderType=cv2.BORDER_REFLECT)
    thick = np.maximum(smooth, 0.0)
    return thick / thick.max()
