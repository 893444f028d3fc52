"""A whole Nico at work, live: sliders turn head and arms, its model predicts what it sees."""

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.errors import ModelError
from nico_selfmodel.model.cameras.stereo_rig import StereoRig
from nico_selfmodel.model.tree.body_model import BodyModel
from nico_selfmodel.names import listed
from nico_selfmodel.sessions.live_station import LiveStation
from nico_selfmodel.sessions.rendered_body import QUICK, RenderedBody
from nico_selfmodel.sessions.whole_recording import WholeRecording
from nico_selfmodel.systems.looking import arms_among
from nico_selfmodel.systems.rendering.stereo_cameras import ImageQuality
from nico_selfmodel.systems.simulated.imperfections import Imperfections
from nico_selfmodel.systems.stations.station_body import StationBody
from nico_selfmodel.systems.tracking.shared_search import corner_names
from nico_selfmodel.viz.live.body_view import WholeBodyView

_DAY = 99
_LOOKS = 3
"""Poses of each hand for one look about the room."""


class WatchingBody(LiveStation[WholeBodyView, Mapping[str, NDArray]]):
    """A station of a whole Nico in its room, and its view; closing gives the station back."""

    def __init__(
        self,
        model: BodyModel,
        world: Imperfections,
        seed: int,
        *,
        quality: ImageQuality | None = None,
        recording: bool = False,
    ) -> None:
        """Wake the robot up and draw it.

        Args:
            model: What it has learned: head, arms, cameras, markers of hands and room.
            world: What is wrong with it.
            seed: Which robot; the one that learned the model.
            quality: Of the pictures.
            recording: Keep an animation.

        Raises:
            ModelError: If the model lacks cameras, or markers that this robot carries or sees.
            ValueError: If it has joints that this robot does not command, or lacks some.
        """
        self.whole = WholeRecording(arms_among(model.tree.joints))
        _check_parts(model, self.whole)
        self.model = model
        self.hands = {
            f"{side} hand": corner_names(marker) for side, marker in self.whole.hands.items()
        }
        lenses = [model.tree.lenses[sensor.name] for sensor in model.tree.sensors]
        robot = RenderedBody(world, seed, self.whole, quality or QUICK)
        self.station = robot.station(_DAY, StereoRig(*lenses))
        self.body = StationBody(self.station, self.station.joints, self.whole.tracked)
        self.view = WholeBodyView(model, self.hands, self._read("encoders"), recording=recording)

    def show(self) -> Mapping[str, NDArray]:
        """Show the station as it is now.

        Returns:
            By hand, and of the room: mean distance of markers from where the body expects them in
            each camera; nan where none is seen [px]. Shape (2,) each.
        """
        readings = self._read("encoders")
        values = self._read("pixels").reshape(len(self.whole.tracked), 4)
        pixels = dict(zip(self.whole.tracked, values, strict=True))
        context = self.body.context
        images = [self.station.picture(context, camera) for camera in ("left", "right")]
        self.view.show(readings, images, pixels)
        expected = self.view.expected(readings)
        return {
            name: _mean_distance(np.array([pixels[m] - expected[m] for m in markers]))
            for name, markers in (self.hands | {"room": tuple(self.whole.room)}).items()
        }

    def go_into_view(self) -> None:
        """Go where the cameras see a hand, or the room where no arm moves."""
        self.body.move_and_measure(self._in_view(1)[0])
        self.show()

    def _to_joint(self, readings: NDArray) -> NDArray:
        return readings * (self.model.si_per_unit / self.model.tree.gear)

    def _to_encoder(self, angles: NDArray) -> NDArray:
        return angles / (self.model.si_per_unit / self.model.tree.gear)

    def _in_view(self, count: int) -> NDArray:
        """Return commands of poses in which the robot would see what it looks at.

        It looks about the room and at the hands, in random order.
        """
        rng = np.random.default_rng(7)
        sides = len(self.hands)
        looks = count // (_LOOKS * sides + 1) if sides else count
        each = -(-(count - looks) // sides) if sides else 0
        joints = self.station.joints
        angles = self.whole.plan(looks, each, rng, self.whole.known(self.model, joints))
        return self.whole.commands(joints, rng.permutation(angles)[:count])


def _mean_distance(off: NDArray) -> NDArray:
    """Return the mean distance in each camera of what is seen [px]. Shape (m, 4) -> (2,)."""
    distance = np.linalg.norm(off.reshape(-1, 2, 2), axis=2)
    seen = np.isfinite(distance)
    total = np.where(seen, distance, 0.0).sum(axis=0)
    return np.where(seen.any(axis=0), total / np.maximum(seen.sum(axis=0), 1), np.nan)


def _check_parts(model: BodyModel, robot: WholeRecording) -> None:
    """Refuse a body that does not know what this robot sees."""
    cameras = [sensor.name for sensor in robot.body.tree.sensors]
    known = [sensor.name for sensor in model.tree.sensors if sensor.name in model.tree.lenses]
    if known != cameras:
        raise ModelError(
            f"body {model.name!r} has the cameras {listed(known) or 'none'}, this robot has "
            f"{listed(cameras)}: learn it with `nico-selfmodel learn --head`"
        )
    names = {marker.name for marker in model.tree.markers}
    if missing := [name for name in robot.tracked if name not in names]:
        raise ModelError(
            f"body {model.name!r} does not know the markers {listed(missing)}, which this robot "
            "sees: learn it with `nico-selfmodel learn --head`"
        )
