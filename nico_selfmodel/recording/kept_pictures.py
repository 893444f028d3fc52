"""A body whose pictures are kept beside what was located in them, to locate it anew."""

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from nico_selfmodel.dataset.body.body_dataset import BodyDataset
from nico_selfmodel.dataset.joint_info import JointInfo
from nico_selfmodel.recording.session import Body
from nico_selfmodel.systems.measurements import CameraMeasurement
from nico_selfmodel.systems.tracking.hand_tracker import Detectors
from nico_selfmodel.vision.images.image_array import as_gray
from nico_selfmodel.vision.images.not_seen import NotSeen

Locate = Callable[[NDArray], NDArray | NotSeen]


class KeptPictures:
    """A body with cameras that keeps the grey pictures of each visit in which it saw a marker.

    Of a recording without mirrors these are the pictures of its samples, in their order.
    """

    def __init__(self, body: Body) -> None:
        """Watch a body that shows its pictures."""
        self._body = body
        self.pairs: list[tuple[NDArray, NDArray]] = []
        """Of the left and the right camera. Shape (h, w) each."""

    @property
    def joints(self) -> tuple[JointInfo, ...]:
        """Names, units and stops of the joints."""
        return self._body.joints

    @property
    def markers(self) -> tuple[str, ...]:
        """Names of the tracked points."""
        return self._body.markers

    def move_and_measure(self, command: ArrayLike) -> CameraMeasurement:
        """Move, look, and keep what is seen.

        Raises:
            ValueError: If the body shows no pictures.
        """
        found = self._body.move_and_measure(command)
        if not isinstance(found, CameraMeasurement) or found.images is None:
            raise ValueError("the body shows no pictures to keep: build it with keep_images=True")
        if any(np.isfinite(pixels).any() for pixels in found.pixels.values()):
            left, right = (as_gray(image) for image in found.images)
            self.pairs.append((left, right))
        return replace(found, images=None)


def located_anew(
    data: BodyDataset,
    pictures: Sequence[tuple[NDArray, NDArray]],
    detectors: Detectors,
) -> BodyDataset:
    """Return a recording of two cameras with its markers located once more in the same pictures.

    Args:
        data: The recording; its first sensor is the left camera, its second the right one.
        pictures: Those of its samples, left and right.

    Returns:
        The same rows with other pixels, without those where nothing is found any more.
    """
    table, names = data.observations, [marker.name for marker in data.markers]
    values = np.array(table.values)
    # The pictures of one camera at one pose in turn: detectors share one search of each.
    for row in np.lexsort((table.sensor, table.pose)).tolist():
        camera = int(table.sensor[row])
        picture = pictures[int(table.pose[row])][camera]
        found = _of(detectors, names[table.marker[row]])[camera](picture)
        values[row, :2] = np.nan if isinstance(found, NotSeen) else found
    keep = np.isfinite(values[:, 0])
    return replace(data, observations=replace(table, values=values).select(keep))


def _of(detectors: Detectors, marker: str) -> Sequence[Locate]:
    found = detectors[marker]
    return found if isinstance(found, tuple) else (found, found)
