"""Stages 5 to 8 of the mirror test: marks, their place, and their removal."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.estimation.monitoring.health import check_health
from nico_selfmodel.experiments.mirror_test.painting import (
    KINDS,
    MARK,
    OTHER_ROBOT,
    SEEN_DIRECTLY,
    STANDING_BESIDE,
    NoPlaceError,
    Painted,
    Painter,
)
from nico_selfmodel.sessions.looks.expecting import MirrorLook
from nico_selfmodel.sessions.looks.finding import Finding
from nico_selfmodel.sessions.looks.look_poses import CLEARANCE
from nico_selfmodel.sessions.looks.mark_finder import MarkFinder
from nico_selfmodel.sessions.looks.mirror_looks import MirrorLooks
from nico_selfmodel.sessions.mirrors.acquaintance import Acquainted, rendered
from nico_selfmodel.sessions.mirrors.knowing import TURNED, Knowing
from nico_selfmodel.sessions.mirrors.mirror_scenario import MIRROR
from nico_selfmodel.sessions.progress import Stage, of_robot
from nico_selfmodel.sessions.shapes.own_arm import look_at_arm
from nico_selfmodel.systems.closing import free_memory
from nico_selfmodel.systems.rendering.body_image import BodyImage
from nico_selfmodel.systems.rendering.stereo_cameras import ImageQuality
from nico_selfmodel.systems.stations.nico_station import NicoStation

REMOVALS = 2
"""Of so many marks one is taken off again, and looked at."""
_DAY = 8
_WAIT = 0.1
"""How long somebody takes to paint, in which a picture's noise becomes another [s]."""
_WATCHED, _DAY_AFTER = 40, 12
"""Poses of the hand by which the monitor judges after the marks, and on which day."""
_POSTURES = 10
"""Pairs of postures that are tried where the first shows no place to be painted."""

Pair = tuple[MirrorLook, MirrorLook]


@dataclass(frozen=True, eq=False)
class MarkTrial:
    """One trial: what was done, and what the robot said, which was not told."""

    robot: int
    """Seed of the robot."""
    painted: Painted
    """What was done."""
    found: tuple[Finding, ...]
    """What the robot says."""
    after: tuple[Finding, ...] | None
    """What it says after the removal; None where nothing was removed."""


@dataclass(frozen=True)
class Watched:
    """What a robot's monitor says of its body after all marks are gone."""

    robot: int
    """Its seed."""
    poses: int
    """In which it saw its hand."""
    changed: str | None
    """What it says that changed; None of a body that is what it was."""


@dataclass(frozen=True, eq=False)
class MarkStage:
    """All trials with marks."""

    trials: tuple[MarkTrial, ...]
    """In the order in which they were made."""
    shown: tuple[Painted, Pair] | None
    """The first look at a mark on the body, for the report."""
    watched: tuple[Watched, ...] = ()
    """Of each robot."""


class _Session:
    """One robot before two mirrors, and somebody with paint."""

    def __init__(self, known: Knowing, image: BodyImage, station: NicoStation) -> None:
        mirrors, self._views = known.robot.model.mirrors, known.before.views
        self._station, self._known = station, known
        self._looks = MirrorLooks(
            station, image, known.robot.model, mirrors[MIRROR], self._views[MIRROR].X_BM
        )
        known.body.pose(image)
        self._finder = MarkFinder(image, known.body)
        noise = (known.before.nico.quality or ImageQuality()).noise
        self._painter = Painter(station, self._looks.body.context, self._views[MIRROR].X_BM, noise)

    def trial(self, kind: str, remove: bool, rng: np.random.Generator) -> tuple[MarkTrial, Pair]:
        """Look, let somebody paint or not, look again and into the other mirror, and judge.

        Raises:
            NoPlaceError: If none of several postures shows a place to be painted.
        """
        (first, second), painted, found, here = self._somewhere(kind, rng)
        self._station.wipe(self._looks.body.context)
        after = None
        if remove:
            again = self._looks.look(second)
            self._before(MIRROR)
            after = self._finder.find((MIRROR, TURNED), (self._looks.look(first), again))
        return MarkTrial(self._known.robot.seed, painted, found, after), here

    def _somewhere(
        self, kind: str, rng: np.random.Generator
    ) -> tuple[tuple[NDArray, NDArray], Painted, tuple[Finding, ...], Pair]:
        """Return postures, and what `_painted` does in them.

        Where the own arm hides all that could be painted, or it is dark, others are taken.
        """
        for left in reversed(range(_POSTURES)):
            try:
                first = self._raised(rng) if kind == SEEN_DIRECTLY else self._command(MIRROR, rng)
                commands = first, self._command(TURNED, rng)
                return commands, *self._painted(kind, commands, rng)
            except NoPlaceError:
                if not left:
                    raise
        raise AssertionError("the last posture returns or raises")

    def _painted(
        self, kind: str, commands: tuple[NDArray, NDArray], rng: np.random.Generator
    ) -> tuple[Painted, tuple[Finding, ...], Pair]:
        """Return what was done, what is said of it, and the look in which it was seen first.

        What has changed in all of a picture is large, and given back before the next looks.
        """
        looks, context = self._looks, self._looks.body.context
        self._station.stand_other(context, STANDING_BESIDE if kind == OTHER_ROBOT else None)
        self._before(MIRROR)
        shot = looks.shot(MIRROR, commands[0])
        painted = self._painter.paint(kind, rng)
        looks.body.simulator.AdvanceTo(context.get_time() + _WAIT)
        here = looks.judge()
        changes = looks.changes(shot, here)
        self._before(TURNED)
        there = looks.look(commands[1])
        return painted, self._finder.find((MIRROR, TURNED), (here, there), changes), here

    def _before(self, name: str) -> None:
        known = self._known
        self._looks.before_known(name, known.body, known.unknown[name], self._views[name].X_BM)

    def _command(self, name: str, rng: np.random.Generator) -> NDArray:
        return rng.choice(self._known.poses[name])

    def _raised(self, rng: np.random.Generator) -> NDArray:
        """Return a posture in which the arm was learned: its hand, at least, is seen directly.

        Raises:
            NoPlaceError: If the arm comes too near to the glass in all of them.
        """
        self._before(MIRROR)
        for command in rng.permutation(self._known.robot.readings):
            if self._looks.clearance(command) > CLEARANCE:
                return command
        raise NoPlaceError(
            f"a raised arm comes within {1e3 * CLEARANCE:.0f} mm of the glass in all postures in "
            "which it was learned: put the mirror farther away"
        )


def run_marks(robots: Sequence[Knowing], trials: int, progress: Stage | None = None) -> MarkStage:
    """Let robots look for marks that may be there or not.

    Args:
        robots: Who know themselves and their mirrors.
        trials: In all: of nine in turn four marks, two shams, one on the glass, one on another
            robot and one that is seen directly, too, in random order.

    Raises:
        ValueError: If there are too few trials.
    """
    check_marks(trials, len(robots))
    seed = robots[0].robot.seed
    order = np.random.default_rng((seed, 46)).permutation(trials)
    kinds = [KINDS[k % len(KINDS)] for k in order]
    done: list[MarkTrial] = []
    after: list[Watched] = []
    shown: tuple[Painted, Pair] | None = None
    for i, known in enumerate(robots):
        stage = of_robot(progress, i, len(robots))
        own = kinds[i :: len(robots)]
        for trial, pair in _trials(known, own, stage):
            done.append(trial)
            if shown is None and trial.painted.kind == MARK:
                shown = trial.painted, pair
        free_memory()
        after.append(watched(known.robot, stage))
    return MarkStage(tuple(done), shown, tuple(after))


def watched(robot: Acquainted, stage: Stage) -> Watched:
    """Let a robot look at its hand in poses in which it was learned, and its monitor judge.

    Args:
        robot: Who knows arm and cameras.
    """
    with TemporaryDirectory() as folder:
        data, _ = look_at_arm(robot, Path(folder) / "after", _WATCHED, stage, _DAY_AFTER)
    report = check_health(robot.model, data)
    if report.healthy:
        return Watched(robot.seed, len(report.nis), None)
    causes = [one.hypothesis.cause for one in report.diagnoses[:1]]
    return Watched(robot.seed, len(report.nis), *(causes or ["that poses contradict it"]))


def check_marks(trials: int, robots: int) -> None:
    """Refuse too few trials with marks.

    Raises:
        ValueError: If there are fewer than kinds of what is done, or than robots.
    """
    fewest = max(len(KINDS), robots)
    if trials < fewest:
        raise ValueError(
            f"--marks must be at least {fewest}, four marks and five controls and one a robot, got "
            f"{trials}"
        )


def _trials(known: Knowing, kinds: Sequence[str], stage: Stage) -> Iterator[tuple[MarkTrial, Pair]]:
    """Make one robot's trials on one station, one after the other: looks are large."""
    robot = known.robot
    nico = rendered(robot, ImageQuality())
    marks = 0
    with BodyImage(nico.arm, robot.model) as image, NicoStation(
        robot.world, robot.seed, _DAY, arm=nico.arm, quality=nico.quality,
        mirror=known.before.plate, other=True,
    ) as station:  # fmt: skip
        session = _Session(known, image, station)
        for k, kind in enumerate(kinds):
            remove = kind == MARK and marks % REMOVALS == 0
            marks += kind == MARK
            rng = np.random.default_rng((robot.seed, 47, k))
            yield session.trial(kind, remove, rng)
            free_memory()  # else each trial leaves some 12 MB in pieces
            stage("looking for marks", k + 1, len(kinds))
