"""The stages of the mirror test that exist, one after the other."""

import logging
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, TypeVar

from nico_selfmodel.errors import SelfModelError
from nico_selfmodel.experiments.mirror_test.body_or_room import TurningStage, run_turning
from nico_selfmodel.experiments.mirror_test.encounters import (
    EncounterStage,
    check_trials,
    run_encounters,
)
from nico_selfmodel.experiments.mirror_test.encounters_report import encounters_document
from nico_selfmodel.experiments.mirror_test.images import ImageStage, images_document, run_images
from nico_selfmodel.experiments.mirror_test.marks import MarkStage, check_marks, run_marks
from nico_selfmodel.experiments.mirror_test.marks_report import marks_documents
from nico_selfmodel.experiments.mirror_test.structure import StructureStage, run_structure
from nico_selfmodel.experiments.mirror_test.touches import TouchStage, run_touches
from nico_selfmodel.experiments.mirror_test.unknown_mirror import (
    MirrorsStage,
    any_beyond,
    place_mirrors,
)
from nico_selfmodel.experiments.mirror_test.unmarked import UnmarkedStage, run_unmarked
from nico_selfmodel.experiments.mirror_test.unmarked_report import unmarked_document
from nico_selfmodel.sessions.mirrors.acquaintance import Acquainted, acquainted
from nico_selfmodel.sessions.mirrors.knowing import PLATE, know_mirrors
from nico_selfmodel.sessions.progress import Stage
from nico_selfmodel.systems.closing import free_memory
from nico_selfmodel.systems.rendering.mirror_scene import MirrorPlate
from nico_selfmodel.systems.simulated.imperfections import Imperfections

_T = TypeVar("_T")
_LOG = logging.getLogger(__name__)


@dataclass(frozen=True, eq=False)
class MirrorTest:
    """What happened in the stages that were begun."""

    encounters: EncounterStage
    """Stage 1."""
    images: ImageStage | None = None
    """Stage 1b; None if stage 1 failed."""
    turning: TurningStage | None = None
    """Stage 1c; None if one before failed. If it fails, the others go on: they do not turn."""
    mirrors: MirrorsStage | None = None
    """Stage 2; None if one before failed."""
    structure: StructureStage | None = None
    """Stage 3; None if one before but 1c failed. If it fails, the others go on: they expect to see
    the description's shapes."""
    unmarked: UnmarkedStage | None = None
    """Stage 4; None if one before failed but 1c and the third."""
    marks: MarkStage | None = None
    """Stages 5, 6 and 8; None if one before failed."""
    touches: TouchStage | None = None
    """Stage 7; None if one before failed, or 8."""
    error: str | None = None
    """What the first stage that is not there ended in, if that was an error."""


def run_stages(
    world: Imperfections,
    seeds: Sequence[int],
    trials: int,
    looks: int,
    marks: int,
    plate: MirrorPlate = PLATE,
    progress: Stage | None = None,
    *,
    share: bool = False,
) -> MirrorTest:
    """Let robots learn themselves and go through the test; who fails one ends there.

    Nothing rests on stages 1c and 3: who fails them goes on. A robot that refuses a mirror ends
    alone, though the stage fails by it: the others trust theirs.

    Args:
        seeds: Which robots.
        trials: Encounters in all.
        looks: Of each robot at its unmarked body.
        marks: Trials with marks in all, controls among them.
        plate: The glass that somebody puts before them from stage 2 on.
        share: Whether these are some of the robots of a test: of how many looks may surprise, and
            how many marks must be found, all of them tell together, so that they go on anyway.

    Raises:
        ValueError: If there are too few trials.
        EstimationError: If a robot cannot learn how its image follows its encoders.
    """
    check_trials(trials, len(seeds))
    check_marks(marks, len(seeds))
    robots = acquainted(world, seeds, progress)
    done: dict[str, Any] = {"encounters": _alone(run_encounters(robots, trials, progress))}
    try:
        _go_on(done, robots, looks, marks, plate, progress, share)
    except Exception as error:
        # An hour of what went before, and of the other robots, is worth a report; an error that
        # nobody raised on purpose is one of the program, and whoever mends it needs its place.
        done["error"] = str(error) or type(error).__name__
        if not isinstance(error, SelfModelError):
            _LOG.exception("robots %s ended in an error of the program", list(seeds))
    return MirrorTest(**done)


def _go_on(
    done: dict[str, Any],
    robots: Sequence[Acquainted],
    looks: int,
    marks: int,
    plate: MirrorPlate,
    progress: Stage | None,
    share: bool,
) -> None:
    """Add the later stages to those that are done, until one fails."""
    if encounters_document(done["encounters"])["status"] == "FAIL":
        return
    done["images"] = _alone(run_images(robots, progress))
    if images_document(done["images"])["status"] == "FAIL":
        return
    done["turning"] = _alone(run_turning(robots, progress))
    known, refused = _alone(know_mirrors(robots, plate, progress))
    done["mirrors"] = place_mirrors(known, refused)
    if not known or any_beyond(done["mirrors"]):
        return
    done["structure"] = _alone(run_structure(known, progress))
    done["unmarked"] = _alone(run_unmarked(known, looks, progress))
    if not share and unmarked_document(done["unmarked"])["status"] == "FAIL":
        return
    done["marks"] = run_marks(known, marks, progress)
    if not share and marks_fail(done["marks"]):
        return
    done["touches"] = run_touches(known, done["structure"].shapes, done["marks"], progress)


def marks_fail(marks: MarkStage) -> bool:
    """Return whether one of the stages that are about marks fails."""
    return any(one["status"] == "FAIL" for one in marks_documents(marks))


def ended(test: MirrorTest) -> MirrorTest:
    """Return a test of several shares without what comes after a stage that all together fail."""
    if test.unmarked is not None and unmarked_document(test.unmarked)["status"] == "FAIL":
        return replace(test, marks=None, touches=None)
    if test.marks is not None and marks_fail(test.marks):
        return replace(test, touches=None)
    return test


def _alone(found: _T) -> _T:
    """Return what a stage found, once all else that it took is given back: renderers are large."""
    free_memory()
    return found
