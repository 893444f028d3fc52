"""Robots that know two mirrors, and how they stand before them, before they look for marks."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.errors import EstimationError
from nico_selfmodel.experiments.mirror_test.acquaintance import Acquainted, rendered
from nico_selfmodel.model.cameras.mirror import Mirror
from nico_selfmodel.sessions.mirrors.known_body import KnownBody, know_body
from nico_selfmodel.sessions.mirrors.look_poses import look_poses
from nico_selfmodel.sessions.mirrors.mirror_looks import MirrorLooks, Unknown
from nico_selfmodel.sessions.mirrors.mirror_scenario import MIRROR, learn_mirror
from nico_selfmodel.sessions.mirrors.nico_before_mirrors import DEFAULT_MIRROR, NicoBeforeMirrors
from nico_selfmodel.sessions.progress import Stage, of_robot
from nico_selfmodel.systems.rendering.body_image import BodyImage
from nico_selfmodel.systems.rendering.mirror_scene import MirrorPlate
from nico_selfmodel.systems.rendering.stereo_cameras import ImageQuality

TURNED = "turned"
"""What the second mirror is called."""
PLACES = {MIRROR: DEFAULT_MIRROR, TURNED: Mirror.from_values([*np.radians([5.0, -20.0]), 0.34])}
"""Where the mirrors are meant to stand; the second is turned by 5 deg and 40 mm farther."""
PLATE = MirrorPlate(width=1.4, height=1.4)
"""A glass that shows the whole body."""
_POSES = 12
"""In which the robot sees its hand in each mirror to learn where that stands."""
_CHOICES = 2000
"""From which those next to poses in which the arm was learned are taken."""
_UNMARKED = 3
"""Poses before each mirror in which it learns how far its unmarked body is from expected."""
_DAY = 6


@dataclass(frozen=True, eq=False)
class Knowing:
    """A robot that knows itself and its mirrors."""

    robot: Acquainted
    """Which robot, and what it learned before."""
    body: KnownBody
    """Mirrors, and how the body stands."""
    unknown: Mapping[str, Unknown]
    """Mirror -> what body and colours are not known by in it."""
    poses: Mapping[str, NDArray]
    """Mirror -> postures to look at itself in, in it [encoder units]. Shape (K, n)."""
    before: NicoBeforeMirrors
    """Where the mirrors really stand, which the robot is not told."""


def know_mirrors(robots: Sequence[Acquainted], progress: Stage | None = None) -> list[Knowing]:
    """Let robots learn mirrors from their hands, and how they stand from head and chest in them.

    Args:
        robots: Who have learned arm and cameras.
        progress: Told how far it is.

    Raises:
        EstimationError: If a robot does not learn where a mirror stands.
    """
    found = []
    for i, robot in enumerate(robots):
        stage = of_robot(progress, i, len(robots))
        learned = learn_mirror(
            robot.model, robot.world, robot.seed, familiar=robot.readings, poses=_POSES,
            plate=PLATE, mirrors=PLACES, arm=rendered(robot).arm, choices=_CHOICES, stage=stage,
        )  # fmt: skip
        if learned.verdict.status == "FAIL":
            raise EstimationError(
                f"robot {robot.seed} did not learn its mirrors: "
                f"{'; '.join(learned.verdict.reasons)}"
            )
        known = Acquainted(robot.seed, robot.world, learned.model, robot.readings)
        found.append(know_itself(known, stage))
    return found


def know_itself(robot: Acquainted, stage: Stage) -> Knowing:
    """Let a robot that has seen its hand in both mirrors look at its unmarked body.

    Args:
        robot: Whose model knows the mirrors.
        stage: Told how far it is.
    """
    nico = rendered(robot, ImageQuality())
    before = NicoBeforeMirrors(nico, PLACES, plate=PLATE)
    rng = np.random.default_rng((robot.seed, 45))
    with BodyImage(nico.arm, robot.model) as image, before.station(_DAY) as station:
        views, mirrors = before.views, robot.model.mirrors
        looks = MirrorLooks(station, image, robot.model, mirrors[MIRROR], views[MIRROR].X_BM)
        shots, poses = [], {}
        for name, view in views.items():
            looks.before(mirrors[name], view.X_BM)
            poses[name] = look_poses(looks, nico.workspace, rng)
            shots.append(looks.shot(name, poses[name][0]))

        def told(step: int, of: int) -> None:
            stage("learning how it stands before mirrors", step, of)

        body = know_body(image, robot.model, shots, told)
        unknown = {}
        for name, view in views.items():
            looks.before(body.mirror(name), view.X_BM)
            unknown[name] = looks.unknown_of(poses[name][: 1 + _UNMARKED][-_UNMARKED:])
    return Knowing(robot, body, MappingProxyType(unknown), MappingProxyType(poses), before)
