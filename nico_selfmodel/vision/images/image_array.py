"""What an image is to a detector."""

import cv2
import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.vision.images.picture_header import LARGEST_SIDE, SMALLEST_SIDE

_NEAR = 1e-3
"""Share of a Gaussian from which on what it covers tells a colour."""


def as_gray(image: NDArray) -> NDArray:
    """Return an image in grey.

    Args:
        image: Grey or BGR, 8 bits. Shape (h, w) or (h, w, 3).

    Returns:
        Shape (h, w).

    Raises:
        ValueError: If the image has another shape or type.
    """
    image = np.asarray(image)
    known = image.ndim in (2, 3) and image.shape[2:] in ((), (3,))
    if image.dtype != np.uint8 or not known or not image.size:
        raise ValueError(
            "image must have 8 bits and shape (h, w) or (h, w, 3),"
            f" got {image.dtype} and {image.shape}"
        )
    return image if image.ndim == 2 else cv2.cvtColor(image, cv2.COLOR_BGR2GRAY)


def as_color(image: NDArray) -> NDArray:
    """Return a copy of an image in blue, green and red.

    Args:
        image: Grey or BGR, 8 bits. Shape (h, w) or (h, w, 3).

    Returns:
        Shape (h, w, 3).

    Raises:
        ValueError: If the image has another shape or type.
    """
    gray = as_gray(image)
    return np.array(image) if np.ndim(image) == 3 else cv2.cvtColor(gray, cv2.COLOR_GRAY2BGR)


def turned_colors(image: NDArray) -> NDArray:
    """Return red, green, blue of blue, green, red, or back. Shape (h, w, 3), 8 bits."""
    return cv2.cvtColor(image, cv2.COLOR_BGR2RGB)


def bgr_of_rgba(image: NDArray) -> NDArray:
    """Return a picture of red, green, blue and opacity as blue, green, red. 8 bits."""
    return cv2.cvtColor(np.ascontiguousarray(image), cv2.COLOR_RGBA2BGR)


def rgba_of_bgr(image: NDArray) -> NDArray:
    """Return a picture of blue, green, red as red, green, blue and opacity. 8 bits."""
    return cv2.cvtColor(np.ascontiguousarray(image), cv2.COLOR_BGR2RGBA)


def sum_of(picture: NDArray, noise: NDArray) -> NDArray:
    """Return the sum of a picture and noise, rounded and cut to 8 bits. Shapes (h, w, 3)."""
    return cv2.add(picture, noise, dtype=cv2.CV_8U)


def detectable(image: NDArray) -> NDArray:
    """Return an image in grey that a detector can look at.

    Args:
        image: Grey or BGR, 8 bits. Shape (h, w) or (h, w, 3).

    Returns:
        Shape (h, w).

    Raises:
        ValueError: If the image has another shape or type, or a side that is too short or long.
    """
    gray = as_gray(image)
    if min(gray.shape) < SMALLEST_SIDE or max(gray.shape) > LARGEST_SIDE:
        raise ValueError(
            f"{gray.shape[1]}x{gray.shape[0]} pixels; an image must have at least {SMALLEST_SIDE} "
            f"a side for anything to be seen in it, and at most {LARGEST_SIDE}"
        )
    return gray


def averaged(image: NDArray, size: tuple[int, int]) -> NDArray:
    """Return an image of a smaller width and height, by means over what each pixel covers.

    Args:
        image: 8 bits. Shape (h, w) or (h, w, channels).
        size: Width and height [px].
    """
    return cv2.resize(np.ascontiguousarray(image), size, interpolation=cv2.INTER_AREA)


def reduced(gray: NDArray, most: int) -> tuple[NDArray, float]:
    """Return a copy of at most so many pixels, and how many pixels of the image one of its is."""
    scale = int(np.ceil((gray.size / most) ** 0.5))
    if scale <= 1:
        return gray, 1.0
    height, width = (side // scale for side in gray.shape)
    whole = gray[: height * scale, : width * scale]
    return averaged(whole, (width, height)), float(scale)


def smoothed_within(picture: NDArray, inside: NDArray, sigma: float) -> NDArray:
    """Return a picture blurred by a Gaussian in which only some pixels count [px], as floats.

    Args:
        picture: Shape (h, w, 3).
        inside: Which count. Shape (h, w).
        sigma: Of the Gaussian [px].

    Returns:
        0 where none of them is near. Shape (h, w, 3).
    """
    counts = inside.astype(np.float32)
    share = smoothed(counts, sigma)
    near = (share > _NEAR)[:, :, None]
    total = smoothed(picture * counts[:, :, None], sigma)
    return np.where(near, total / np.where(near, share[:, :, None], 1.0), 0.0)


def smoothed(picture: NDArray, sigma: float) -> NDArray:
    """Return a picture blurred by a Gaussian [px], as floats. Shape (h, w, 3)."""
    return cv2.GaussianBlur(picture.astype(np.float32), (0, 0), sigma)


def between_pixels(image: NDArray, pixels: NDArray) -> NDArray:
    """Return what an image shows between its pixels, its edge beyond them.

    Args:
        image: 8 bits. Shape (h, w) or (h, w, 3).
        pixels: u and v, integers are pixel centres. Shape (..., n, 2).

    Returns:
        Shape (..., n) or (..., n, 3).
    """
    *many, n, _ = pixels.shape
    u, v = np.moveaxis(pixels.reshape(-1, n, 2).astype(np.float32), -1, 0)
    found = cv2.remap(image, u, v, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    return found.reshape(*many, n, *image.shape[2:])
