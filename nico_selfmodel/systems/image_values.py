"""Drake's images and numpy's: red, green, blue, opacity on the wires, BGR for the detectors."""

import numpy as np
from numpy.typing import NDArray
from pydrake.common.value import AbstractValue
from pydrake.systems.sensors import ImageRgba8U

from nico_selfmodel.vision.images.image_array import bgr_of_rgba, rgba_of_bgr


def image_value(width: int, height: int) -> AbstractValue:
    """Return a black picture in the form that ports carry."""
    return AbstractValue.Make(ImageRgba8U(width, height))


def bgr_of(image: ImageRgba8U) -> NDArray:
    """Return a copy of a picture as blue, green, red. Shape (h, w, 3)."""
    return bgr_of_rgba(np.asarray(image.data))


def write_bgr(bgr: NDArray, image: ImageRgba8U) -> None:
    """Write blue, green, red of shape (h, w, 3) into a picture of that size."""
    np.asarray(image.mutable_data)[:] = rgba_of_bgr(bgr)
