"""What an image is to a detector."""

import cv2
import numpy as np
from numpy.typing import NDArray


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
    if image.dtype != np.uint8 or image.ndim not in (2, 3) or image.shape[2:] not in ((), (3,)):
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
