"""Two real cameras as a Drake system with the output ports of `StereoCameras`."""

from typing import Any

from pydrake.common.value import AbstractValue
from pydrake.systems.framework import Context, EventStatus, LeafSystem, State

from nico_selfmodel.errors import RobotError
from nico_selfmodel.model.cameras.rig_parameters import SIDES
from nico_selfmodel.systems.image_values import image_value, write_bgr
from nico_selfmodel.vision.images.stereo_capture import StereoCapture, StereoPair
from nico_selfmodel.with_blocks import OpenedAtStart


class CameraDriver(OpenedAtStart, LeafSystem):
    """Shows what two cameras see, always the newest pair of pictures.

    | port | | carries |
    |---|---|---|
    | `left_image` | out | picture of the left camera, `ImageRgba8U` |
    | `right_image` | out | picture of the right camera, `ImageRgba8U` |

    Both pictures were taken within the capture's tolerance of each other; pictures that nobody
    looks at are dropped, never queued. A camera that is lost raises `CameraLostError` from
    `Simulator.AdvanceTo`, with its cause. Making one opens nothing: call `open`, or use it in a
    `with` block.
    """

    def __init__(self, capture: StereoCapture) -> None:
        """Take the cameras.

        Args:
            capture: The two cameras, looked at as often as there are pictures; opened and closed
                through this driver.
        """
        super().__init__()
        self.period = 1.0 / capture.fps
        self.capture, self.image_size = capture, capture.size
        self._pair = self.DeclareAbstractState(AbstractValue.Make([]))
        self.DeclareInitializationUnrestrictedUpdateEvent(self._take_over)
        self.DeclarePeriodicUnrestrictedUpdateEvent(self.period, 0.0, self._take_over)
        known = {self.abstract_state_ticket(self._pair)}
        for camera, name in enumerate(SIDES):
            self.DeclareAbstractOutputPort(
                f"{name}_image",
                lambda: image_value(*self.image_size),
                lambda context, value, camera=camera: self._show(context, value, camera),
                prerequisites_of_calc=known,
            )

    def open(self) -> None:
        """Open both cameras and wait for their first pictures.

        Raises:
            RobotError: If a camera cannot be opened or gives nothing.
        """
        self.capture.open()

    def close(self) -> None:
        """Free both cameras; never fails."""
        self.capture.close()

    def pair_of(self, context: Context) -> StereoPair:
        """Return the pictures that the ports show, with the times at which they were taken.

        Raises:
            RobotError: If there are none yet.
        """
        film: Any = context.get_abstract_state(self._pair).get_value()
        if not film:
            raise RobotError(
                "there is no picture yet: initialize or advance the simulator before looking"
            )
        return film[0]

    def _take_over(self, context: Context, state: State) -> EventStatus:
        """Take the newest pair."""
        holder: Any = state.get_mutable_abstract_state(int(self._pair))
        holder.set_value([self.capture.latest()])
        return EventStatus.Succeeded()

    def _show(self, context: Context, value: AbstractValue, camera: int) -> None:
        write_bgr(self.pair_of(context).images[camera], value.get_mutable_value())
