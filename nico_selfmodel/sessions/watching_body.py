"""A whole Nico at work, live: sliders turn head and arms, its model predicts what it sees."""

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.errors import ModelError
from nico_selfmodel.model.cameras.mirror import Mirror
from nico_selfmodel.model.cameras.stereo_rig import StereoRig
from nico_selfmodel.model.tree.body_model import BodyModel
from nico_selfmodel.names import listed
from nico_selfmodel.planning.body_before_mirror import BodyBeforeMirror
from nico_selfmodel.sessions.live_station import LiveStation
from nico_selfmodel.sessions.mirrors.body_recorded_before_mirrors import FINE
from nico_selfmodel.sessions.mirrors.nico_before_mirrors import DEFAULT_MIRROR
from nico_selfmodel.sessions.rendered_body import QUICK, RenderedBody
from nico_selfmodel.sessions.watching import ELSEWHERE, ELSEWHERE_M
from nico_selfmodel.sessions.whole_recording import WholeRecording
from nico_selfmodel.systems.looking import arms_among
from nico_selfmodel.systems.rendering.mirror_scene import MirrorPlate, put_mirror
from nico_selfmodel.systems.simulated.imperfections import Imperfections
from nico_selfmodel.systems.stations.station_body import StationBody
from nico_selfmodel.systems.tracking.shared_search import corner_names
from nico_selfmodel.viz.live.body_view import WholeBodyView
from nico_selfmodel.viz.live.station_mirror import StandingGlass

_DAY = 99
_LOOKS = 3
"""Poses of each hand for one look about the room."""
_PLATE = MirrorPlate()
"""The glass that is put before it."""


class WatchingBody(LiveStation[WholeBodyView, Mapping[str, NDArray]]):
    """A station of a whole Nico in its room, and its view; closing gives the station back."""

    def __init__(
        self,
        model: BodyModel,
        world: Imperfections,
        seed: int,
        *,
        mirror: tuple[str, Mirror | None] | None = None,
        recording: bool = False,
    ) -> None:
        """Wake the robot up and draw it.

        Args:
            model: What it has learned: head, arms, cameras, markers of hands and room.
            seed: Which robot; the one that learned the model.
            mirror: A mirror that the model knows, and where it is put before the left camera of
                the robot as described that looks straight ahead; None as place for where
                `simulate whole-body --mirror` puts one.

        Raises:
            ModelError: If the model lacks cameras, or markers that this robot carries or sees; or
                if the mirror was learned to stand elsewhere.
            ValueError: If it has joints that this robot does not command, or lacks some.
        """
        self.whole = WholeRecording(arms_among(model.tree.joints))
        _check_parts(model, self.whole)
        self.model = model
        self.hands = {
            f"{side} hand": corner_names(marker) for side, marker in self.whole.hands.items()
        }
        lenses = [model.tree.lenses[sensor.name] for sensor in model.tree.sensors]
        robot = RenderedBody(world, seed, self.whole, QUICK if mirror is None else FINE)
        self._before = None if mirror is None else _before(model, self.whole, *mirror)
        plate = None if mirror is None else _PLATE
        self.station = robot.station(_DAY, StereoRig(*lenses), plate)
        self.body = StationBody(self.station, self.station.joints, self.whole.tracked)
        glass = None
        if mirror is not None and self._before is not None:
            X_WM = self._before.glass.X_WM
            put_mirror(self.station, self.body.context, X_WM)
            glass = StandingGlass(mirror[0], X_WM, _PLATE.width, _PLATE.height)
        self.view = WholeBodyView(
            model, self.hands, self._read("encoders"), glass=glass, recording=recording
        )

    def show(self) -> Mapping[str, NDArray]:
        """Show the station as it is now.

        Returns:
            By hand, of the room, and by hand in the mirror: mean distance of markers from where the
            body expects them in each camera; nan where none is seen [px]. Shape (2,) each.
        """
        readings, context = self._read("encoders"), self.body.context
        images = [self.station.picture(context, camera) for camera in ("left", "right")]
        pixels, expected = self._tracked("pixels"), self.view.expected(readings)
        reflected = None if self._before is None else self._tracked("reflected_pixels")
        self.view.show(readings, images, pixels, reflected)
        groups = self.hands | {"room": tuple(self.whole.room)}
        off = {name: _apart(pixels, expected, markers) for name, markers in groups.items()}
        if reflected is not None:
            behind = self.view.expected_in_mirror(readings)
            off |= {
                f"{name} in the mirror": _apart(reflected, behind, markers)
                for name, markers in self.hands.items()
            }
        return off

    def _tracked(self, port: str) -> dict[str, NDArray]:
        values = self._read(port).reshape(len(self.whole.tracked), 4)
        return dict(zip(self.whole.tracked, values, strict=True))

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

        It looks about the room and at the hands, in random order; at their reflections where there
        is a mirror.
        """
        rng, joints = np.random.default_rng(7), self.station.joints
        if self._before is not None:
            turns = self._before.by_turns(tuple(self.whole.hands.values()), count, rng)
            return self.whole.commands(joints, np.array([q for _, q in turns]))
        sides = len(self.hands)
        looks = count // (_LOOKS * sides + 1) if sides else count
        each = -(-(count - looks) // sides) if sides else 0
        angles = self.whole.plan(looks, each, rng, self.whole.known(self.model, joints))
        return self.whole.commands(joints, rng.permutation(angles)[:count])


def _apart(
    seen: Mapping[str, NDArray], expected: Mapping[str, NDArray], markers: Sequence[str]
) -> NDArray:
    """Return the mean distance of markers that are seen in each camera [px]. Shape (2,)."""
    off = np.array([seen[name] - expected[name] for name in markers])
    distance = np.linalg.norm(off.reshape(-1, 2, 2), axis=2)
    known = np.isfinite(distance)
    total = np.where(known, distance, 0.0).sum(axis=0)
    return np.where(known.any(axis=0), total / np.maximum(known.sum(axis=0), 1), np.nan)


def _before(
    model: BodyModel, robot: WholeRecording, name: str, place: Mirror | None
) -> BodyBeforeMirror:
    """Return the robot before a mirror that is put somewhere.

    Raises:
        ModelError: If it was learned to stand elsewhere, or hardly any pose shows a hand in it.
        ValueError: If the model does not know it, or no arm moves.
    """
    learned = model.tree.mirror(name).plane
    if not robot.arms:
        raise ValueError(
            f"body {model.name!r} moves no arm, and sees nothing of itself in a mirror"
        )
    size, hands = (_PLATE.width, _PLATE.height), list(robot.hands.values())
    before = BodyBeforeMirror.of(
        robot.view, place or DEFAULT_MIRROR, size, hands, np.random.default_rng(7)
    )
    put, middle = before.glass.plane, before.glass.X_WM[:3, 3]
    turned = float(np.linalg.norm(np.cross(learned.normal, put.normal)))
    apart = abs(float(learned.distance_to(middle)))
    if turned > np.sin(ELSEWHERE) or apart > ELSEWHERE_M:
        raise ModelError(
            f"mirror {name!r} was learned {np.degrees(np.arcsin(min(turned, 1.0))):.0f} deg and "
            f"{1e3 * apart:.0f} mm from where it is put: say where to put it as it was recorded, "
            f"--mirror {name}=MM,DEG,DEG"
        )
    return before


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
