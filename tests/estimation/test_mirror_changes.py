"""A mirror that is moved while the hand is watched in it, and an encoder that jumps meanwhile."""

from dataclasses import replace

import numpy as np
import pytest

from nico_selfmodel.estimation.judging import judge
from nico_selfmodel.estimation.mirrors.mirror import calibrate_mirrors
from nico_selfmodel.model.cameras.mirror import Mirror
from nico_selfmodel.model.cameras.mirror_rig import MirrorRig

from .mirror_scenes import MIRROR, RIG, SECOND, body, poses, recording, together

PLAY = 4e-3


def unsure_body(seed):
    """Return a body whose arm is wrong within its covariance."""
    model, rng = body(True), np.random.default_rng((seed, 9))
    values, sigma = model.parameters.values.copy(), np.sqrt(np.diag(model.covariance.matrix))
    errors = sigma * rng.standard_normal(len(sigma))
    for name, off in zip(model.covariance.names, errors, strict=True):
        if name in model.parameters.names:
            values[model.parameters.names.index(name)] += off
    arm = model.parameters.with_values(values)
    return replace(model, table=arm.table, servo_map=arm.servos)


def moved(by_mm, count=20, seed=0):
    """Return reflections in a mirror that is set back in the middle."""
    values = MIRROR.values + np.array([0.0, 0.0, 1e-3 * by_mm])
    behind, q, half = MirrorRig(RIG, Mirror.from_values(values)), poses(count, seed), count // 2
    before = recording(q[:half], play=PLAY, seed=seed)
    later = recording(q[half:], behind, play=PLAY, seed=seed + 1000, first=half + 1)
    return together(before, later)


def test_a_mirror_that_is_moved_half_way_is_named_with_size_and_sample():
    calibration = calibrate_mirrors(moved(10.0), body(True))
    what = calibration.change.what
    assert what.startswith("mirror 'glass' moved by about ")
    assert what.endswith(" deg after sample 10")
    assert float(what.split()[5]) == pytest.approx(10.0, abs=1.0)
    verdict = judge(calibration)
    assert verdict.status == "FAIL"
    assert len(verdict.reasons) == 1  # and it is not called bent


def test_an_encoder_that_jumps_before_a_mirror_is_named_and_the_mirror_is_not():
    q = poses(40)
    data = recording(q, play=PLAY)
    encoders = data.encoders.copy()
    encoders[25:, 3] += 1.6 * np.radians(3.0)
    change = calibrate_mirrors(replace(data, encoders=encoders), body(True)).change
    assert change.what.startswith("the encoder of 'elbow' jumped by about ")
    assert change.what.endswith("after sample 25")
    assert change.reason is not None


def test_the_mirror_that_stood_still_beside_one_that_moved_is_not_named():
    still = recording(
        poses(20, mirror=SECOND), MirrorRig(RIG, SECOND), "other", play=PLAY, first=50
    )
    calibration = calibrate_mirrors(together(moved(12.0), still), body(True))
    assert "'glass'" in calibration.change.what
    assert "'other'" not in calibration.change.what


@pytest.mark.parametrize("count", [13, 20])
def test_nothing_is_told_of_a_mirror_that_stood_still(count):
    # ... nor of so few samples that no part would tell of a change.
    assert calibrate_mirrors(moved(0.0, count), unsure_body(0)).change is None


def test_thirteen_samples_are_too_few_and_fourteen_are_not():
    assert calibrate_mirrors(moved(20.0, 13, seed=1), body(True)).change is None
    assert calibrate_mirrors(moved(20.0, 14, seed=1), body(True)).change is not None


@pytest.mark.slow
@pytest.mark.parametrize("count", [20, 46])
def test_mirrors_that_stood_still_are_never_said_to_have_moved(count):
    for seed in range(100, 160):
        calibration = calibrate_mirrors(moved(0.0, count, seed), unsure_body(seed))
        change = calibration.change
        assert change is None or change.reason is None


@pytest.mark.slow
def test_six_millimetres_of_a_mirror_are_told_in_twenty_poses_three_times_of_four():
    told = [
        calibrate_mirrors(moved(6.0, 20, seed), unsure_body(seed)).change
        for seed in range(100, 140)
    ]
    named = [one for one in told if one is not None and "mirror 'glass' moved" in one.what]
    assert len(named) >= 0.75 * len(told)
