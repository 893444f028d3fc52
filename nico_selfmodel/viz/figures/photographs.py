"""Photographs as small files that a page or a scene can hold."""

from collections.abc import Mapping

import numpy as np
from numpy.typing import ArrayLike, NDArray

from nico_selfmodel.vision.images.image_array import averaged, between_pixels, turned_colors
from nico_selfmodel.vision.images.image_file import encoded

Photographs = Mapping[str, Mapping[str, NDArray]]
"""Camera -> view -> red, green and blue, or grey; 8 bits. Shape (h, w, 3) or (h, w)."""

_QUALITY, _PACKED, _OUTSIDE = 82, 6, 215


def photograph_of(
    photographs: Photographs | None, side: str, view: str, image_size: tuple[int, int]
) -> NDArray | None:
    """Return one photograph, or None where there is none.

    Args:
        image_size: Width and height that were calibrated [px].

    Returns:
        Red, green and blue. Shape (h, w, 3).

    Raises:
        ValueError: If it is not an image, or one of another size.
    """
    image = (photographs or {}).get(side, {}).get(view)
    if image is None:
        return None
    image = in_colour(image)
    if image.shape[:2] != image_size[::-1]:
        raise ValueError(
            f"the {side} image of view {view} is {image.shape[1]} x {image.shape[0]}, the "
            f"camera was calibrated for {image_size[0]} x {image_size[1]}"
        )
    return image


def in_colour(image: ArrayLike) -> NDArray:
    """Return an image as red, green and blue.

    Args:
        image: The same, or grey; 8 bits. Shape (h, w, 3) or (h, w).

    Returns:
        Shape (h, w, 3).

    Raises:
        ValueError: If it is something else.
    """
    image = np.asarray(image)
    if image.ndim == 2:
        image = np.repeat(image[:, :, None], 3, axis=2)
    if image.ndim != 3 or image.shape[2] != 3 or image.dtype != np.uint8 or not image.size:
        raise ValueError(
            f"an image must be 8 bits of shape (h, w) or (h, w, 3), got {image.dtype} {image.shape}"
        )
    return image


def shrunk(image: NDArray, width: int) -> NDArray:
    """Return an image smaller but at least so wide, by means over whole blocks of pixels.

    Pixels that fill no block are left out on the right and below.

    Args:
        image: 8 bits. Shape (h, w, 3).
        width: [px].
    """
    step = image.shape[1] // width
    if step <= 1 or image.shape[0] < step:
        return image
    rows, columns = (size // step for size in image.shape[:2])
    return averaged(image[: rows * step, : columns * step], (columns, rows))


def jpeg(image: NDArray) -> bytes:
    """Return an image as a JPEG file. Shape (h, w, 3), red, green, blue, 8 bits."""
    return encoded(turned_colors(np.ascontiguousarray(image)), ".jpg", _QUALITY)


def png(image: NDArray) -> bytes:
    """Return an image as a PNG file. Shape (h, w, 4), red, green, blue, opacity, 8 bits."""
    return encoded(np.ascontiguousarray(image[:, :, [2, 1, 0, 3]]), ".png", _PACKED)


def resampled(image: NDArray, pixels: NDArray) -> NDArray:
    """Return the colours of an image between its pixels, grey outside of it.

    Args:
        image: 8 bits. Shape (h, w, 3).
        pixels: u and v, integers are pixel centres; nan lies outside. Shape (..., n, 2).

    Returns:
        Shape (..., n, 3).
    """
    limit = np.array(image.shape[1::-1]) - 0.5
    inside = np.all((pixels >= -0.5) & (pixels <= limit), axis=-1)[..., None]
    mixed = between_pixels(np.ascontiguousarray(image), np.where(inside, pixels, 0.0))
    return np.where(inside, mixed, np.uint8(_OUTSIDE))
