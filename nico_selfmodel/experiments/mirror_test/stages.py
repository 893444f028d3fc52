"""The stages of the mirror test that exist, one after the other."""

from collections.abc import Sequence
from dataclasses import dataclass

from nico_selfmodel.experiments.mirror_test.acquaintance import acquainted
from nico_selfmodel.experiments.mirror_test.encounters import (
    EncounterStage,
    check_trials,
    run_encounters,
)
from nico_selfmodel.experiments.mirror_test.encounters_report import encounters_document
from nico_selfmodel.experiments.mirror_test.knowing import know_mirrors
from nico_selfmodel.experiments.mirror_test.marks import MarkStage, check_marks, run_marks
from nico_selfmodel.experiments.mirror_test.marks_report import marks_documents
from nico_selfmodel.experiments.mirror_test.structure import StructureStage, run_structure
from nico_selfmodel.experiments.mirror_test.touches import TouchStage, run_touches
from nico_selfmodel.experiments.mirror_test.unknown_mirror import MirrorsStage, place_mirrors
from nico_selfmodel.experiments.mirror_test.unknown_mirror_report import mirrors_document
from nico_selfmodel.experiments.mirror_test.unmarked import UnmarkedStage, run_unmarked
from nico_selfmodel.experiments.mirror_test.unmarked_report import unmarked_document
from nico_selfmodel.sessions.progress import Stage
from nico_selfmodel.systems.simulated.imperfections import Imperfections


@dataclass(frozen=True, eq=False)
class MirrorTest:
    """What happened in the stages that were begun."""

    encounters: EncounterStage
    """Stage 1."""
    mirrors: MirrorsStage | None = None
    """Stage 2; None if stage 1 failed."""
    structure: StructureStage | None = None
    """Stage 3; None if one before failed. If it fails, the others go on: their shapes are the
    description's."""
    unmarked: UnmarkedStage | None = None
    """Stage 4; None if 1 or 2 failed."""
    marks: MarkStage | None = None
    """Stages 5, 6 and 8; None if one before failed."""
    touches: TouchStage | None = None
    """Stage 7; None if one before failed, or 8."""


def run_stages(
    world: Imperfections,
    seeds: Sequence[int],
    trials: int,
    looks: int,
    marks: int,
    progress: Stage | None = None,
) -> MirrorTest:
    """Let robots learn themselves and go through the test; who fails one but the third ends there.

    Args:
        world: What is wrong with the bodies.
        seeds: Which robots.
        trials: Encounters in all.
        looks: Of each robot at its unmarked body.
        marks: Trials with marks in all, controls among them.
        progress: Told how far it is.

    Returns:
        What happened.

    Raises:
        ValueError: If there are too few trials.
        EstimationError: If a robot cannot learn how its image follows its encoders, or where a
            mirror stands.
    """
    check_trials(trials, len(seeds))
    check_marks(marks, len(seeds))
    robots = acquainted(world, seeds, progress)
    met = run_encounters(robots, trials, progress)
    if encounters_document(met)["status"] == "FAIL":
        return MirrorTest(met)
    known = know_mirrors(robots, progress)
    placed = place_mirrors(known)
    if mirrors_document(placed)["status"] == "FAIL":
        return MirrorTest(met, placed)
    shape = run_structure(known, progress)
    unmarked = run_unmarked(known, looks, progress)
    if unmarked_document(unmarked)["status"] == "FAIL":
        return MirrorTest(met, placed, shape, unmarked)
    found = run_marks(known, marks, progress)
    if any(one["status"] == "FAIL" for one in marks_documents(found)):
        return MirrorTest(met, placed, shape, unmarked, found)
    return MirrorTest(met, placed, shape, unmarked, found, run_touches(known, found, progress))
