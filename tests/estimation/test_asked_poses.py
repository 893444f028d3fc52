"""Which poses the ladder asks, and when a body solved with what stayed is refused."""

from types import SimpleNamespace

import numpy as np
import pytest

from nico_selfmodel.estimation.bending.asked_poses import ENOUGH_POSES, MOST_ROWS, drawn_poses
from nico_selfmodel.estimation.bending.ladder import Ladder, _is_better


def test_few_rows_are_all_asked():
    pose = np.repeat(np.arange(MOST_ROWS // 2), 2)
    assert set(drawn_poses(pose, 0)) == set(pose)


def test_of_many_poses_as_many_as_tell_an_effect_are_asked():
    assert len(drawn_poses(np.arange(10 * MOST_ROWS), 0)) == MOST_ROWS


@pytest.mark.parametrize("poses", [ENOUGH_POSES, ENOUGH_POSES + 40])
def test_of_poses_with_many_rows_enough_are_asked(poses):
    """Noise of joints is that of a pose: 500 rows of 12 poses would tell little."""
    pose = np.repeat(np.arange(poses), 40)
    assert len(drawn_poses(pose, 0)) == ENOUGH_POSES


def test_asked_poses_are_drawn_by_the_seed():
    pose = np.repeat(np.arange(400), 40)
    one, again, other = (set(drawn_poses(pose, seed)) for seed in (1, 1, 2))
    assert one == again != other


@pytest.mark.parametrize(("worse", "kept"), [(-0.1, True), (0.9, True), (1.1, False)])
def test_a_body_whose_poses_are_worse_by_more_than_the_standard_error_is_refused(worse, kept):
    rng = np.random.default_rng(0)
    rigid = rng.normal(size=50)
    changes = rng.normal(size=50)
    changes -= changes.mean()
    error = changes.std(ddof=1) / np.sqrt(50)
    logs = {"rigid": rigid, "bent": rigid + changes + worse * error}
    body = SimpleNamespace(
        posture=_Posture("rigid"),
        posture_of=lambda _: _Posture("bent"),
        log_errors=lambda posture: logs[posture],
    )
    assert _is_better(Ladder((), None, adopted=True), body) is kept


class _Posture(str):
    """A body by its name."""

    gears = np.ones(3)
