"""A body whose hand is measured by instruments beside it, too: to judge what it learns."""

from collections.abc import Callable
from dataclasses import replace
from types import MappingProxyType

import numpy as np
from numpy.typing import ArrayLike, NDArray

from nico_selfmodel.dataset.joint_info import JointInfo
from nico_selfmodel.recording.session import Body
from nico_selfmodel.systems.measurements import CameraMeasurement


class ObservedBody:
    """A body with cameras; a pose is measured from outside where its cameras see the hand."""

    def __init__(self, body: Body, locate: Callable[[], NDArray], *, cameras: int) -> None:
        """Watch a body.

        Args:
            locate: Gives the markers where the body is now, in the left camera's frame, nan
                where one is lost [m]. Shape (m, 3).
            cameras: How many of its cameras must see a marker: 1 or 2.
        """
        self._body, self._locate, self._cameras = body, locate, cameras

    @property
    def joints(self) -> tuple[JointInfo, ...]:
        """Names, units and stops of the joints."""
        return self._body.joints

    @property
    def markers(self) -> tuple[str, ...]:
        """Names of the tracked points."""
        return self._body.markers

    def move_and_measure(self, command: ArrayLike) -> CameraMeasurement:
        """Move, look, and be measured in the left camera's frame; a point that is lost is None."""
        found = self._body.move_and_measure(command)
        assert isinstance(found, CameraMeasurement)
        points = {}
        for marker, p_LH in zip(self.markers, self._locate(), strict=True):
            seen = np.isfinite(found.pixels[marker]).sum() >= 2 * self._cameras
            points[marker] = p_LH if seen and np.isfinite(p_LH).all() else None
        return replace(found, points=MappingProxyType(points))
