"""A robot that moves, and watches whether what it sees moves with it."""

from collections import deque
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.errors import RobotError
from nico_selfmodel.estimation.contingency.motion_response import LITTLE, MUCH, STILL
from nico_selfmodel.model.cameras.rig_parameters import SIDES
from nico_selfmodel.model.self_model import SelfModel
from nico_selfmodel.planning.motor_program import MotorProgram
from nico_selfmodel.planning.own_view import OwnArmInView
from nico_selfmodel.plant import ArmDescription
from nico_selfmodel.systems.rendering.mirror_scene import put_mirror
from nico_selfmodel.systems.stations.moving_robots import MovingRobots
from nico_selfmodel.systems.stations.nico_station import NicoStation
from nico_selfmodel.vision.images.motion_mask import CELL, moving_cells

PERIOD = 0.05
"""Time between two pictures [s]."""
_LITTLE = 3e-4
"""What moves most of arm and fingers moves so little between two pictures that they need not show
it, by the learned arm: a fifth of a pixel in a mirror [m]."""
_REMEMBERED = 0.5
"""How old a picture may be when it arrives, at most [s]."""
_WARM_UP = 1.5
"""Time in which the arm goes to its first pose before anything is watched [s]."""
_BEFORE_US = 0.85
"""Distance of the second robot, along where the head looks [m]."""


@dataclass(frozen=True)
class Encounter:
    """Who or what is before the robot while it moves."""

    name: str
    """What it is called."""
    mirror: bool = False
    """Whether a mirror stands there."""
    other: bool = False
    """Whether a second robot does."""
    late: float | None = None
    """How late that one repeats the first one's motion [s]; None if it moves as it likes."""


class MotionSession:
    """A station on which encounters are watched, one after the other."""

    def __init__(
        self, station: NicoStation, model: SelfModel, X_BM: NDArray, gaze: float, latency: float
    ) -> None:
        """Take a station with a mirror and a second robot.

        Args:
            station: Open; it is not closed here.
            model: What the robot has learned of arm and cameras.
            X_BM: Where somebody puts the mirror, in the frame of the arm's base. Shape (4, 4).
            gaze: Direction in which the head looks, about the vertical [rad].
            latency: How old pictures are when they arrive, which the robot is not told [s].

        Raises:
            RobotError: If the station moves more than an arm.
        """
        if not isinstance(station.arm, ArmDescription):
            raise RobotError(
                "encounters are watched by a head that stands still: build the station with an arm"
            )
        self._station, self._X_BM = station, X_BM
        self._whole = int(latency / PERIOD)
        self._rest = latency - self._whole * PERIOD
        self._own = [OwnArmInView(station.arm, model, one, CELL) for one in model.rig.cameras]
        self._X_WO = facing(gaze)

    def watch(
        self,
        encounter: Encounter,
        poses: NDArray,
        seconds: float,
        rng: np.random.Generator,
        delay: int | None = None,
    ) -> Iterator[tuple[int, bool, bool]]:
        """Move at random and say after each pair of pictures what encoders and images did.

        Both cameras look: what the own arm hides from one of them it need not hide from the other,
        before which it is elsewhere.

        Args:
            encounter: Who is there.
            poses: To move between [encoder units]. Shape (P, n).
            seconds: How long to watch, at most.
            delay: How many pictures old a picture is when it arrives, as far as is known; up to
                half a second if omitted.

        Yields:
            How the encoders moved since the pictures before, `STILL`, `LITTLE` or `MUCH`; whether
            an image did, in cells that the own arm may have covered in it; and whether one did in
            all others.
        """
        warm = _WARM_UP + (encounter.late or 0.0)
        own = MotorProgram.random(poses, warm + seconds, rng)
        other = MotorProgram.random(poses, warm + seconds, rng)
        if encounter.late is not None:
            other = own.later(encounter.late)
        motion = MovingRobots(self._station, own, other)
        put_mirror(self._station, motion.context, self._X_BM if encounter.mirror else None)
        self._station.stand_other(motion.context, self._X_WO if encounter.other else None)
        covered: deque[NDArray] = deque(maxlen=int(np.ceil(_REMEMBERED / PERIOD)))
        late: deque[NDArray | None] = deque([None] * self._whole)
        pictures, readings = None, None
        for k in range(int(seconds / PERIOD)):
            motion.advance(warm + k * PERIOD)
            before, pictures = pictures, self._pictures(motion.context)
            motion.advance(warm + k * PERIOD + self._rest)
            last, readings = readings, motion.readings()
            covered.append(_joined(one.cells(readings) for one in self._own))
            if before is None or last is None:
                continue
            late.append(_joined(map(moving_cells, before, pictures)))
            moving, mine = late.popleft(), _covered_then(covered, delay)
            if moving is None:
                moving = np.zeros_like(mine)
            own, elsewhere = (bool((moving & cells).any()) for cells in (mine, ~mine))
            yield self._moved(last, readings), own, elsewhere

    def _pictures(self, context: Any) -> list[NDArray]:
        """Return what both cameras see. Shape (h, w, 3) each."""
        return [self._station.picture(context, side) for side in SIDES]

    def _moved(self, before: NDArray, now: NDArray) -> int:
        """Return how arm or fingers moved between two readings, by the learned arm.

        A wrist that turns about the marker on the hand moves the fingers alone.
        """
        earlier, later = (self._own[0].points(readings)[0] for readings in (before, now))
        most = float(np.linalg.norm(later - earlier, axis=1).max())
        return STILL if most == 0.0 else LITTLE if most < _LITTLE else MUCH


def _joined(cells: Iterable[NDArray]) -> NDArray:
    """Return the cells of both cameras' pictures, one after the other. Shape (k,)."""
    return np.concatenate([one.ravel() for one in cells])


def _covered_then(covered: deque[NDArray], delay: int | None) -> NDArray:
    """Return the cells of the own arm in a pair of pictures, and in the one before it.

    Args:
        covered: Cells at the last readings, the newest last.
        delay: Readings d by which a picture is older than the newest, or up to one more.
    """
    if delay is None:
        return np.any(covered, axis=0)
    newest = max(len(covered) - delay, 1)
    return np.any(list(covered)[max(newest - 3, 0) : newest], axis=0)


def facing(gaze: float) -> NDArray:
    """Return the pose of a robot that stands where the head looks, and looks back.

    Args:
        gaze: Direction in which the head looks, about the vertical [rad].

    Returns:
        In the frame of the first robot's root. Shape (4, 4).
    """
    turned = gaze + np.pi
    X_WO = np.eye(4)
    X_WO[:2, :2] = [[np.cos(turned), -np.sin(turned)], [np.sin(turned), np.cos(turned)]]
    X_WO[:2, 3] = _BEFORE_US * np.array([np.cos(gaze), np.sin(gaze)])
    return X_WO
