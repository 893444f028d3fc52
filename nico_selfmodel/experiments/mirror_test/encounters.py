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
from nico_selfmodel.sessions.mirrors.acquaintance import Acquainted, rendered
from nico_selfmodel.sessions.mirrors.nico_before_mirrors import DEFAULT_MIRROR, NicoBeforeMirrors
from nico_selfmodel.sessions.motion_session import PERIOD, Encounter, MotionSession
from nico_selfmodel.sessions.progress import Stage, of_robot
from nico_selfmodel.sessions.rendered_nico import RenderedNico
from nico_selfmodel.systems.looking import LOOKING_DEG
from nico_selfmodel.systems.rendering.stereo_cameras import ImageQuality
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
_LATEST = 0.12
"""Pictures are up to this old when they arrive; how old is the robot's own business to find [s]."""
_DAY = 6


@dataclass(frozen=True, eq=False)
class Trial:
    """One encounter, and what was thought of it."""

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
    robots: Sequence[Acquainted], trials: int, progress: Stage | None = None
) -> EncounterStage:
    """Let robots meet whom they cannot tell beforehand.

    Args:
        robots: Who have learned arm and cameras.
        trials: In all, each kind of encounter as often as possible, in random order.

    Raises:
        ValueError: If there are too few trials.
        NotIdentifiableError: If a robot cannot learn how its image follows its encoders.
    """
    check_trials(trials, len(robots))
    kinds = [ENCOUNTERS[i % len(ENCOUNTERS)] for i in range(trials)]
    order = np.random.default_rng((robots[0].seed, 41)).permutation(trials)
    done: list[Trial] = []
    responses, latencies = {}, {}
    for i, robot in enumerate(robots):
        own = [kinds[k] for k in order[i :: len(robots)]]
        latency = float(np.random.default_rng((robot.seed, 40)).uniform(0.0, _LATEST))
        met, response = _meet(robot, own, latency, of_robot(progress, i, len(robots)))
        done += met
        responses[robot.seed], latencies[robot.seed] = response, latency
    return EncounterStage(tuple(done), responses, latencies)


def check_trials(trials: int, robots: int) -> None:
    """Refuse too few trials.

    Raises:
        ValueError: If there are fewer trials than kinds of encounters, or than robots.
    """
    fewest = max(len(ENCOUNTERS), robots)
    if trials < fewest:
        raise ValueError(
            f"--trials must be at least {fewest}, one of each kind of encounter and one a robot, "
            f"got {trials}"
        )


def _meet(
    robot: Acquainted, encounters: Sequence[Encounter], latency: float, stage: Stage
) -> tuple[list[Trial], MotionResponse]:
    """Let one robot watch its arm, and then meet others."""
    nico = rendered(robot, ImageQuality(supersample=1))
    before = NicoBeforeMirrors(nico, {"mirror": DEFAULT_MIRROR})
    with NicoStation(
        robot.world, robot.seed, _DAY, arm=nico.arm, quality=nico.quality, mirror=before.plate,
        other=True,
    ) as station:  # fmt: skip
        view = before.views["mirror"]
        gaze = float(np.radians(LOOKING_DEG["neck_yaw"]))
        session = MotionSession(station, robot.model, view.X_BM, gaze, latency)
        poses = commands_of_angles(station.joints, nico.arm.lower, nico.arm.upper, view.q)
        stage("watching its own arm", 0, 1)
        response = _watching(session, nico, station, np.random.default_rng((robot.seed, 42)))
        stage("watching its own arm", 1, 1)
        trials = []
        for k, encounter in enumerate(encounters):
            rng = np.random.default_rng((robot.seed, 43, k))
            found = _judged(session, encounter, poses, response, rng)
            trials.append(Trial(encounter.name, found))
            stage("meeting others", k + 1, len(encounters))
    return trials, response


def _watching(
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
    moved: list[int] = []
    seen: list[bool] = []
    found = tell_contingency(moved, seen, response)
    for m, _, y in session.watch(encounter, poses, LONGEST, rng, response.delay):
        moved.append(m)
        seen.append(y)
        found = tell_contingency(moved, seen, response)
        if found.settled:
            break
    return found
