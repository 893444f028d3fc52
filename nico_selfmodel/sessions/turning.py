"""A robot that turns torso, then neck, and asks what of its pictures turns with its cameras."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.estimation.contingency.body_or_room import BodyOrRoom, tell_body
from nico_selfmodel.model.cameras.camera import Camera
from nico_selfmodel.model.cameras.rig_parameters import SIDES
from nico_selfmodel.planning.plans import commands_of_angles
from nico_selfmodel.sessions.whole_body import cards_about_nico
from nico_selfmodel.systems.looking import NECK_JOINTS, TORSO_JOINTS, looking, turning_body
from nico_selfmodel.systems.rendering.stereo_cameras import ImageQuality
from nico_selfmodel.systems.simulated.imperfections import Imperfections
from nico_selfmodel.systems.stations.nico_detectors import body_detectors
from nico_selfmodel.systems.stations.nico_station import NicoStation
from nico_selfmodel.systems.stations.seen_surface import UNSEEN, SeenSurface
from nico_selfmodel.systems.stations.station_body import StationBody
from nico_selfmodel.vision.images.motion_mask import CELL, picture_noise
from nico_selfmodel.vision.images.standing_cells import standing_cells

TORSO, NECK = "torso", "neck"
TURNED = {TORSO: TORSO_JOINTS, NECK: NECK_JOINTS}
"""What is turned, as commanded, by its joints: about the vertical, and down."""
_LEFT, _DOWN = (-0.23, -0.11, 0.14, 0.27), (-0.13, 0.1)
"""By how much, each with each; unevenly, for rooms have things that look alike at even distances
[rad]."""
_RAYS = 4
"""Lines of sight of each cell in either direction by which it is judged what is there."""
HEAD = ("head", "left_eye", "right_eye", "eyes")
"""Links that the neck carries."""
_DAY = 12


@dataclass(frozen=True, eq=False)
class TurnedLook:
    """What one camera's picture told, cell by cell, as the torso or the neck turned."""

    turned: str
    """`torso` or `neck`."""
    side: str
    """Which camera."""
    picture: NDArray
    """What it saw before, BGR. Shape (h, w, 3)."""
    shows: NDArray
    """Cells that show something. Boolean, shape (rows, columns)."""
    told: BodyOrRoom
    """What the robot says."""
    body_true: NDArray
    """Cells that show nothing but what turns along, for judging. Boolean, shape (rows, columns)."""
    room_true: NDArray
    """Cells about which nothing of it is seen. Boolean, shape (rows, columns)."""


def look_while_turning(
    world: Imperfections | str, seed: int, arm: Mapping[str, float], session: int = _DAY
) -> tuple[TurnedLook, ...]:
    """Let a robot hold its arm before its cameras, and turn torso and neck.

    Args:
        world: What is wrong with its body.
        seed: Which robot.
        arm: Joint -> angle of its right arm [rad].
        session: Which day.

    Returns:
        Both cameras' looks at torso, then neck.
    """
    body = turning_body()
    still = np.array([{**looking(), **arm}.get(joint, 0.0) for joint in body.joints])
    quality = ImageQuality(supersample=1)
    with NicoStation(
        world, seed, session, arm=body, detectors=body_detectors(), quality=quality,
        room=cards_about_nico(),
    ) as station:  # fmt: skip
        robot = StationBody(station, station.joints, station.tracked)

        def pictures(q: NDArray) -> list[NDArray]:
            commands = commands_of_angles(station.joints, body.lower, body.upper, q[None])
            robot.move_and_measure(commands[0])
            return [station.picture(robot.context, side).copy() for side in SIDES]

        before, again = pictures(still), pictures(still)
        noise = [picture_noise(*both) for both in zip(before, again, strict=True)]
        rig = station.ground_truth_in(robot.context).rig
        surface = SeenSurface(station.surfaces_true(robot.context), rig, None)
        looks = []
        for name, joints in TURNED.items():
            columns = [body.joints.index(joint) for joint in joints]
            found = []
            for turn in np.stack(np.meshgrid(_LEFT, _DOWN), axis=-1).reshape(-1, 2):
                q = still.copy()
                q[columns] += turn
                both = zip(before, pictures(q), noise, strict=True)
                found.append([standing_cells(*one) for one in both])
            for k, side in enumerate(SIDES):
                shows = np.array([cells[k].shows for cells in found])
                told = tell_body(shows, np.array([cells[k].changed for cells in found]))
                asked = np.asarray(shows.any(axis=0))
                true = _true_cells(surface, rig.cameras[k], asked, name)
                looks.append(TurnedLook(name, side, before[k], asked, told, *true))
    return tuple(looks)


def _true_cells(
    surface: SeenSurface, camera: Camera, asked: NDArray, turned: str
) -> tuple[NDArray, NDArray]:
    """Return which of some cells show only what turns along, and about which nothing of it is.

    What the body hides a part of is neither, nor what a camera's own rim does.
    """
    near = np.lib.stride_tricks.sliding_window_view(np.pad(asked, 1), (3, 3)).any(axis=(2, 3))
    row, column = np.nonzero(near)
    within = CELL / _RAYS * (np.arange(_RAYS) + 0.5) - 0.5
    y, x = (CELL * one[:, None] + within for one in (row, column))
    pixels = np.stack(np.broadcast_arrays(x[:, None, :], y[:, :, None]), axis=-1)
    shown = surface.shown(camera, pixels.reshape(-1, 2)).reshape(len(row), -1)
    along = (shown != "") & (shown != UNSEEN)
    along = along if turned == TORSO else np.isin(shown, HEAD)
    body, free = np.zeros_like(asked), np.ones_like(asked)
    body[row, column] = along.all(axis=1)
    free[row, column] = ~along.any(axis=1) & (shown != UNSEEN).all(axis=1)
    about = np.pad(free, 1, constant_values=True)
    about = np.lib.stride_tricks.sliding_window_view(about, (3, 3)).all(axis=(2, 3))
    return body & asked, about & asked
