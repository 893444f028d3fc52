"""Robots that know two mirrors, and how they stand before them, before they look for marks."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.errors import EstimationError
from nico_selfmodel.model.cameras.mirror import Mirror
from nico_selfmodel.sessions.looks.expecting import Unknown
from nico_selfmodel.sessions.looks.known_body import KnownBody, know_body
from nico_selfmodel.sessions.looks.look_poses import look_poses
from nico_selfmodel.sessions.looks.mirror_looks import MirrorLooks
from nico_selfmodel.sessions.mirrors.acquaintance import Acquainted, rendered
from nico_selfmodel.sessions.mirrors.mirror_scenario import (
    DAY,
    MIRROR,
    MirrorScenario,
    learn_mirror,
)
from nico_selfmodel.sessions.mirrors.nico_before_mirrors import DEFAULT_MIRROR, NicoBeforeMirrors
from nico_selfmodel.sessions.progress import Stage, of_robot
from nico_selfmodel.systems.closing import free_memory
from nico_selfmodel.systems.rendering.body_image import BodyImage
from nico_selfmodel.systems.rendering.mirror_scene import MirrorPlate
from nico_selfmodel.systems.rendering.stereo_cameras import ImageQuality

TURNED = "turned"
"""What the second mirror is called."""
PLACES = {MIRROR: DEFAULT_MIRROR, TURNED: Mirror.from_values([*np.radians([5.0, -20.0]), 0.34])}
"""Where the mirrors are meant to stand; the second is turned by 5 deg and 40 mm farther."""
PLATE = MirrorPlate(width=1.4, height=1.4)
"""A glass that shows the whole body."""
GLASSES = {
    "flat": PLATE,
    "bent": replace(PLATE, radius=5.0),
    "dirty": replace(PLATE, dirt=0.5),
    "half": replace(PLATE, width=0.14),
}
"""What somebody may put before the robot: flat, clean and large enough, or not."""
TRUSTED = 0.003
"""Share of the unmarked head and chest that a mirror may show otherwise than expected: flat clean
ones of robots 1853, 1893, 1894, 1912 and 1913 show none, stained ones of 1919 5 to 6 in 1000."""
PAINT_SIGMA = 0.1
"""What colours of robots before mirrors differ by from their description, as a share."""
LINKS = ("head", "chest")
"""What is looked at in mirrors, and learned there."""
MARKED = (*LINKS, "right_upper_arm", "right_elbow_yoke", "right_forearm")
"""What is marked: these and the arm, but for its wrist and hand, to which things are attached."""
_POSES, _HELD_OUT = 30, 8
"""In which the robot sees its hand in each mirror, to learn where that stands and to judge it."""
_CHOICES = 2000
"""From which those next to poses in which the arm was learned are taken."""
_UNMARKED = 3
"""Poses before each mirror in which it learns how far its unmarked body is from expected."""
_DAY = 6
_DAYS = (DAY, 9)
"""On which it learns where mirrors stand: the second if it doubts what it saw on the first, for of
flat ones it doubts one in a thousand."""


def glass_named(name: str) -> MirrorPlate:
    """Return what somebody may put before the robot.

    Raises:
        ValueError: If there is none of that name; the message lists those there are.
    """
    if name not in GLASSES:
        raise ValueError(f"--glass {name}: there are {', '.join(GLASSES)}")
    return GLASSES[name]


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
    unlike: Mapping[str, float]
    """Mirror -> which share of the unmarked head and chest it shows otherwise than expected."""
    before: NicoBeforeMirrors
    """Where the mirrors really stand, which the robot is not told."""


@dataclass(frozen=True)
class Refusal:
    """A robot that does not trust what it sees in a mirror."""

    robot: int
    """Its seed."""
    reason: str
    """What it says."""


def know_mirrors(
    robots: Sequence[Acquainted], plate: MirrorPlate = PLATE, progress: Stage | None = None
) -> tuple[tuple[Knowing, ...], tuple[Refusal, ...]]:
    """Let robots learn mirrors from their hands, and how they stand from head and chest in them.

    Args:
        robots: Who have learned arm and cameras.
        plate: The glass that somebody puts before them.

    Returns:
        Those that know their mirrors now, and what those say who do not trust them.
    """
    found, refused = [], []
    for i, robot in enumerate(robots):
        stage = of_robot(progress, i, len(robots))
        try:
            learned = learn_two_mirrors(robot, plate, stage)
            free_memory()
            found.append(trusting(know_itself(with_mirrors(robot, learned), plate, stage)))
        except EstimationError as error:
            refused.append(Refusal(robot.seed, str(error)))
    return tuple(found), tuple(refused)


def learn_two_mirrors(robot: Acquainted, plate: MirrorPlate, stage: Stage) -> MirrorScenario:
    """Let a robot learn where mirrors stand from its hand in them, and look again if it doubts.

    Args:
        robot: Who has learned arm and cameras.

    Raises:
        EstimationError: If it does not, in either of two sets of poses.
    """
    reasons: tuple[str, ...] = ()
    for day in _DAYS:
        learned = learn_mirror(
            robot.model, robot.world, robot.seed, familiar=robot.readings, poses=_POSES,
            held_out=_HELD_OUT, plate=plate, mirrors=PLACES, arm=rendered(robot).arm,
            choices=_CHOICES, day=day, stage=stage,
        )  # fmt: skip
        if learned.verdict.status != "FAIL":
            return learned
        reasons = learned.verdict.reasons
    raise EstimationError("; ".join(reasons))


def with_mirrors(robot: Acquainted, learned: MirrorScenario) -> Acquainted:
    """Return a robot that knows the mirrors that it has learned, and how they err together."""
    together = learned.calibration.covariance
    return replace(robot, model=replace(learned.model, covariance=together))


def trusting(known: Knowing) -> Knowing:
    """Return a robot that trusts its mirrors.

    Raises:
        EstimationError: If one shows the unmarked body otherwise than expected.
    """
    mirror = max(known.unlike, key=lambda name: known.unlike[name])
    share = known.unlike[mirror]
    if share > TRUSTED:
        raise EstimationError(
            f"mirror {mirror!r} shows {100.0 * share:.1f} % of the unmarked head and chest "
            "otherwise than expected: it is dirty, bent, or ends before them"
        )
    return known


def know_itself(robot: Acquainted, plate: MirrorPlate, stage: Stage) -> Knowing:
    """Let a robot that has seen its hand in both mirrors look at its unmarked body."""
    nico = rendered(robot, ImageQuality())
    before = NicoBeforeMirrors(nico, PLACES, plate=plate)
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
        unknown, unlike = {}, {}
        for name, view in views.items():
            # By what a description is known by: what is learned next takes stains for colours.
            looks.before_known(name, body, Unknown(), view.X_BM)
            unlike[name] = looks.unlike(poses[name][:1], LINKS)
            unknown[name] = looks.unknown_of(poses[name][: 1 + _UNMARKED][-_UNMARKED:])
    return Knowing(
        robot,
        body,
        MappingProxyType(unknown),
        MappingProxyType(poses),
        MappingProxyType(unlike),
        before,
    )
