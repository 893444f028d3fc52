"""Stage 1 of the mirror test: is it me, told by the timing of motion (thesis, chapter 10)."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.estimation.contingency.contingency import (
    NOBODY,
    NOT_ME,
    SELF,
    Contingency,
    tell_contingency,
)
from nico_selfmodel.estimation.contingency.motion_response import MotionResponse, learn_response
from nico_selfmodel.planning.plans import commands_of_angles
from nico_selfmodel.sessions.camera_scenario import Counts, learn_cameras_and_arm
from nico_selfmodel.sessions.motion_session import PERIOD, Encounter, MotionSession
from nico_selfmodel.sessions.nico_before_mirrors import DEFAULT_MIRROR, NicoBeforeMirrors
from nico_selfmodel.sessions.progress import Stage, of_robot
from nico_selfmodel.sessions.rendered_nico import RenderedNico
from nico_selfmodel.systems.looking import LOOKING_DEG
from nico_selfmodel.systems.rendering.stereo_cameras import ImageQuality
from nico_selfmodel.systems.simulated.imperfections import Imperfections
from nico_selfmodel.systems.stations.nico_station import NicoStation

ENCOUNTERS = (
    Encounter("mirror", mirror=True),
    Encounter("other robot", other=True),
    *(
        Encounter(f"own motion {late:g} s late", other=True, late=late)
        for late in (5.0, 1.0, 0.3, 0.1)
    ),
    Encounter("nobody"),
)
"""What a robot meets; who is late is a second robot that does what the first one did."""
EXPECTED = {one.name: SELF if one.mirror else NOT_ME for one in ENCOUNTERS} | {"nobody": NOBODY}
"""What is true of each; where nobody is, `not me` is no mistake either."""
LONGEST = 10.0
"""How long each is watched at most [s]."""
_ACQUAINTANCE = 20.0
"""How long the robot watches its own arm before [s]."""
_COUNTS = Counts(boards=12, circle=32, random=60, test=12)
"""What arm and cameras are learned from: the arm's outline in the image needs centimetres."""
_LATEST = 0.12
"""Pictures are up to this old when they arrive; how old is the robot's own business to find [s]."""
_MARKER, _DAY = "fiducial", 6


@dataclass(frozen=True, eq=False)
class Trial:
    """One encounter, and what was thought of it."""

    robot: int
    """Seed of the robot."""
    encounter: str
    """What it was, which the robot was not told."""
    found: Contingency
    """What the robot says."""

    @property
    def wrong(self) -> bool:
        """Whether the verdict is false; `cannot tell` is none."""
        told_self, true = self.found.verdict == SELF, EXPECTED[self.encounter]
        if true == SELF:
            return self.found.verdict in (NOT_ME, NOBODY)
        return told_self or (true == NOT_ME and self.found.verdict == NOBODY)


@dataclass(frozen=True, eq=False)
class EncounterStage:
    """All trials of the first stage."""

    trials: tuple[Trial, ...]
    """In the order in which they were made."""
    responses: dict[int, MotionResponse]
    """What each robot learned of its own motion."""
    latencies: dict[int, float]
    """How old each robot's pictures really were [s]."""


def run_encounters(
    world: Imperfections, robots: int, trials: int, seed: int, progress: Stage | None = None
) -> EncounterStage:
    """Let robots learn themselves, and meet whom they cannot tell beforehand.

    Args:
        world: What is wrong with the bodies.
        robots: How many of them.
        trials: In all, each kind of encounter as often as possible, in random order.
        seed: Of the first robot, and of the order.
        progress: Told how far it is.

    Returns:
        All trials.

    Raises:
        ValueError: If there are fewer trials than kinds of encounters, or than robots.
        NotIdentifiableError: If a robot cannot learn how its image follows its encoders.
    """
    if trials < max(len(ENCOUNTERS), robots):
        raise ValueError(
            f"--trials must be at least {max(len(ENCOUNTERS), robots)}, one of each kind of "
            f"encounter and one a robot, got {trials}"
        )
    kinds = [ENCOUNTERS[i % len(ENCOUNTERS)] for i in range(trials)]
    order = np.random.default_rng((seed, 41)).permutation(trials)
    done: list[Trial] = []
    responses, latencies = {}, {}
    for i in range(robots):
        own = [kinds[k] for k in order[i::robots]]
        robot = seed + i
        latencies[robot] = float(np.random.default_rng((robot, 40)).uniform(0.0, _LATEST))
        stage = of_robot(progress, i, robots)
        met, responses[robot] = _meet(world, robot, own, latencies[robot], stage)
        done += met
    return EncounterStage(tuple(done), responses, latencies)


def _meet(
    world: Imperfections, robot: int, encounters: Sequence[Encounter], latency: float, stage: Stage
) -> tuple[list[Trial], MotionResponse]:
    """Let one robot learn itself and meet others."""
    counts = _COUNTS
    learned = learn_cameras_and_arm(world, robot, markers=(_MARKER,), counts=counts, stage=stage)
    model = learned.arms[_MARKER].model
    nico = RenderedNico(world, robot, (_MARKER,), ImageQuality(supersample=1))
    before = NicoBeforeMirrors(nico, {"mirror": DEFAULT_MIRROR})
    with NicoStation(
        world, robot, _DAY, arm=nico.arm, quality=nico.quality, mirror=before.plate, other=True
    ) as station:
        view = before.views["mirror"]
        gaze = float(np.radians(LOOKING_DEG["neck_yaw"]))
        session = MotionSession(station, model, view.X_BM, gaze, latency)
        poses = commands_of_angles(station.joints, nico.arm.lower, nico.arm.upper, view.q)
        stage("watching its own arm", 0, 1)
        response = _acquainted(session, nico, station, np.random.default_rng((robot, 42)))
        stage("watching its own arm", 1, 1)
        trials = []
        for k, encounter in enumerate(encounters):
            rng = np.random.default_rng((robot, 43, k))
            trials.append(
                Trial(robot, encounter.name, _judged(session, encounter, poses, response, rng))
            )
            stage("meeting others", k + 1, len(encounters))
    return trials, response


def _acquainted(
    session: MotionSession, nico: RenderedNico, station: NicoStation, rng: np.random.Generator
) -> MotionResponse:
    """Let a robot watch its own arm directly, nobody else being there."""
    q = nico.workspace.random_poses(60, rng)
    poses = commands_of_angles(station.joints, nico.arm.lower, nico.arm.upper, q)
    watched = list(session.watch(Encounter("acquaintance"), poses, _ACQUAINTANCE, rng))
    moved, own, elsewhere = np.array(watched).T
    return learn_response(moved, own, elsewhere, PERIOD)


def _judged(
    session: MotionSession,
    encounter: Encounter,
    poses: NDArray,
    response: MotionResponse,
    rng: np.random.Generator,
) -> Contingency:
    """Watch an encounter until it is settled, or for as long as may be."""
    moved: list[bool] = []
    seen: list[bool] = []
    found = tell_contingency(moved, seen, response)
    for m, _, y in session.watch(encounter, poses, LONGEST, rng):
        moved.append(m)
        seen.append(y)
        found = tell_contingency(moved, seen, response)
        if found.settled:
            break
    return found
