"""The stages of the mirror test that exist, one after the other."""

from collections.abc import Sequence

from nico_selfmodel.experiments.mirror_test.acquaintance import acquainted
from nico_selfmodel.experiments.mirror_test.encounters import (
    EncounterStage,
    check_trials,
    run_encounters,
)
from nico_selfmodel.experiments.mirror_test.encounters_report import encounters_document
from nico_selfmodel.experiments.mirror_test.unmarked import UnmarkedStage, run_unmarked
from nico_selfmodel.sessions.progress import Stage
from nico_selfmodel.systems.simulated.imperfections import Imperfections


def run_stages(
    world: Imperfections,
    seeds: Sequence[int],
    trials: int,
    looks: int,
    progress: Stage | None = None,
) -> tuple[EncounterStage, UnmarkedStage | None]:
    """Let robots learn themselves and go through the test; who fails a stage ends there.

    Args:
        world: What is wrong with the bodies.
        seeds: Which robots.
        trials: Encounters in all.
        looks: Of each robot at its unmarked body.
        progress: Told how far it is.

    Returns:
        What happened in both stages; None for the second where the first failed.

    Raises:
        ValueError: If there are too few trials.
        EstimationError: If a robot cannot learn how its image follows its encoders, or where the
            mirror stands.
    """
    check_trials(trials, len(seeds))
    robots = acquainted(world, seeds, progress)
    met = run_encounters(robots, trials, progress)
    if encounters_document(met)["status"] == "FAIL":
        return met, None
    return met, run_unmarked(robots, looks, progress)
