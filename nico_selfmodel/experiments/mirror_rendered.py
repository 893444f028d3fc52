"""Chapter 9 of the thesis through rendered pictures: the hand found in three mirrors."""

from collections.abc import Mapping

import numpy as np

from nico_selfmodel.dataset.dataset import Dataset
from nico_selfmodel.errors import DataError
from nico_selfmodel.experiments.mirror import (
    POSES,
    TEST_POSES,
    MirrorExperiment,
    Trial,
    experiment_of,
)
from nico_selfmodel.model.cameras.mirror import Mirror
from nico_selfmodel.sessions.body_scenario import learn_body
from nico_selfmodel.sessions.camera_scenario import RenderedNico
from nico_selfmodel.sessions.mirrors.nico_before_mirrors import NicoBeforeMirrors
from nico_selfmodel.sessions.progress import Stage, of_robot, telling
from nico_selfmodel.systems.simulated.imperfections import Imperfections

MARKER = "fiducial"
RENDERED_MIRRORS: Mapping[str, Mirror] = {
    "near": Mirror.from_values([*np.radians([0.0, -20.0]), 0.28]),
    "middle": Mirror.from_values([*np.radians([10.0, -15.0]), 0.34]),
    "far": Mirror.from_values([*np.radians([-10.0, -25.0]), 0.40]),
}
"""Where mirrors are meant to stand so that a fiducial of 29 mm can be read in them."""
PIXEL_SIGMA = 0.1
"""What the centre of a rendered fiducial is off by in a mirror, each coordinate [px]."""
TRAIN_DAY, TEST_DAY = 4, 5


def run_rendered_mirror(
    world: Imperfections,
    individuals: int = 1,
    seed: int = 0,
    progress: Stage | None = None,
) -> MirrorExperiment:
    """Let robots learn cameras and arm from pictures, then three mirrors by looking into them.

    Args:
        individuals: Simulated robots; minutes each.
        seed: Of the first one.

    Raises:
        DataError: If too few poses showed the hand in a mirror.
    """
    trials = []
    for i in range(individuals):
        stage = of_robot(progress, i, individuals)
        trials.append(_trial(world, seed + i, stage))
    play = float(np.degrees(world.play))
    return experiment_of(trials, PIXEL_SIGMA, play, RENDERED_MIRRORS, rendered=True)


def _trial(world: Imperfections, seed: int, stage: Stage) -> Trial:
    """Let one robot learn.

    Raises:
        DataError: If too few poses showed the hand in a mirror.
    """
    scenario = learn_body(world, seed, marker=MARKER, stage=stage)
    # One camera is enough for a pose to count, so that both may have seen fewer.
    direct = _seen_by_both(scenario.arm.test, "", TEST_POSES, TEST_POSES // 2)
    nico = RenderedNico(world, seed, (MARKER,))
    before = NicoBeforeMirrors(nico, RENDERED_MIRRORS, rig=scenario.model.rig)

    train = before.record(
        "train", TRAIN_DAY, max(POSES), progress=telling(stage, "looking into mirrors")
    )
    test = before.record(
        "test",
        TEST_DAY,
        TEST_POSES,
        best=False,
        progress=telling(stage, "mirrors, kept for judging"),
    )
    truth = nico.ground_truth
    true = {name: truth.mirror(view.X_BM) for name, view in before.views.items()}
    stage("learning mirrors", 0, 1)
    found = Trial.of(
        scenario.model,
        direct,
        {name: _seen_by_both(train, name, max(POSES)) for name in RENDERED_MIRRORS},
        {name: _seen_by_both(test, name, TEST_POSES) for name in RENDERED_MIRRORS},
        PIXEL_SIGMA,
        true,
    )
    stage("learning mirrors", 1, 1)
    return found


def _seen_by_both(data: Dataset, mirror: str, count: int, fewest: int | None = None) -> Dataset:
    """Return the first rows of a view (a mirror, or "" for the hand itself) that both cameras saw.

    Raises:
        DataError: If there are fewer than are enough: as many as are taken if omitted.
    """
    rows = np.flatnonzero((data.mirror == mirror) & np.isfinite(data.pixels).all(axis=1))
    fewest = count if fewest is None else fewest
    if len(rows) < fewest:
        raise DataError(
            f"only {len(rows)} of {fewest} poses show the hand to both cameras "
            + (f"in mirror {mirror!r}" if mirror else "directly")
        )
    return data.select(rows[:count])
