"""The centre of a marker seen through a lens that is known.

A lens bends the edges of a marker, and the diagonals do not meet in the image of its centre: near
the border of a wide image that is half a pixel. So the marker is looked at once more in a patch
from which the lens has been taken out.
"""

from dataclasses import replace

import cv2
import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.geometry.homography import marker_center
from nico_selfmodel.model.cameras.camera import Camera
from nico_selfmodel.vision.images.image_array import as_gray
from nico_selfmodel.vision.images.not_seen import NotSeen
from nico_selfmodel.vision.markers.fiducial import Fiducial
from nico_selfmodel.vision.markers.fiducial_family import FiducialFamily
from nico_selfmodel.vision.markers.marker_edges import corners_from_edges

_ROOM = 0.35
"""Of the marker's size, kept around it in the patch."""
_LARGEST_PATCH = 2.0
"""Side of the patch over that of the image."""


def behind_lens(image: NDArray, seen: Fiducial, camera: Camera) -> Fiducial | NotSeen:
    """Locate a marker once more, through a calibrated lens.

    Args:
        image: In which the marker was found; grey or BGR, 8 bits. Shape (h, w) or (h, w, 3).
        seen: The marker as found there.

    Returns:
        The marker with corners and centre where the camera shows them [px]; or why not.

    Raises:
        ValueError: If the image has another shape or type.
    """
    gray = as_gray(image)
    if not camera.has_rays(seen.corners).all():
        return NotSeen("the marker lies where the calibrated lens has no rays")
    ideal = camera.undistort(seen.corners)
    # As many pixels to the patch as the marker has in the image.
    span = np.ptp(ideal, axis=0).max()
    scale = np.ptp(seen.corners, axis=0).max() / span
    low = ideal.min(axis=0) - _ROOM * span
    size = np.ceil((ideal.max(axis=0) + _ROOM * span - low) * scale).astype(int)
    if not 1 <= size.max() <= _LARGEST_PATCH * max(gray.shape):
        return NotSeen("the calibrated lens draws the marker out of all proportion")
    grid = np.stack(np.meshgrid(*(np.arange(n) for n in size)), axis=-1) / scale + low
    u, v = camera.pixels_of(np.moveaxis(grid, -1, 0)).astype(np.float32)
    patch = cv2.remap(gray, u, v, cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE)
    cells = FiducialFamily(seen.family).cells
    corners = corners_from_edges(patch, (ideal - low) * scale, cells)
    if corners is None:
        return NotSeen("the marker's edges are not plain to see behind the lens")
    center = camera.pixels_of(marker_center(corners) / scale + low)
    return replace(seen, corners=camera.pixels_of((corners / scale + low).T).T, center=center)
