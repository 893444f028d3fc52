"""Time and memory of learning an arm grow with its poses, and no faster."""

import time
import tracemalloc

import numpy as np
import pytest

from nico_selfmodel.dataset.dataset import Dataset
from nico_selfmodel.estimation.arm.kinematics import calibrate_kinematics
from nico_selfmodel.planning.sweep_protocol import SweepProtocol
from nico_selfmodel.plant import ArmDescription
from nico_selfmodel.sessions.simulated_session import simulated_session
from nico_selfmodel.systems.simulated.imperfections import IMPERFECTIONS

pytestmark = pytest.mark.benchmark


@pytest.fixture(scope="module")
def recorded():
    """Return a function that adds random poses of the learned arm to its recorded sweeps."""
    arm = ArmDescription.named("nico")
    world = IMPERFECTIONS["clean"].with_noise(play_deg=0.5, marker_mm=0.5)
    sweeps = simulated_session(arm, world, SweepProtocol.for_arm(arm), "sweeps", seed=0, session=0)
    model = calibrate_kinematics(sweeps).model
    low, high = sweeps.encoders.min(axis=0), sweeps.encoders.max(axis=0)

    def more(count):
        rng = np.random.default_rng(count)
        free = rng.uniform(low, high, (count - len(sweeps), len(low)))
        points = model.predict(free).p_WH + 1e-3 * rng.normal(size=(len(free), 3))
        return Dataset(
            "many",
            sweeps.joints,
            np.arange(count),
            np.vstack([sweeps.encoders, free]),
            np.vstack([sweeps.p_WH_measured, points]),
            np.concatenate([sweeps.sweep, np.full(len(free), "")]),
            point_sigma_m=1e-3,
        )

    return more


def seconds_of(data):
    began = time.process_time()
    calibrate_kinematics(data)
    return time.process_time() - began


def test_eight_times_the_poses_take_at_most_eight_times_as_long(recorded):
    few, many = recorded(5_000), recorded(40_000)
    ratio = min(seconds_of(many) / seconds_of(few) for _ in range(3))
    print(f"{ratio:.2f} times the time of an eighth of the poses")
    assert ratio <= 8.0


def test_a_pose_more_takes_less_than_two_kilobytes(recorded):
    data = [recorded(5_000), recorded(40_000)]
    peaks = []
    for one in data:
        tracemalloc.start()
        calibrate_kinematics(one)
        peaks.append(tracemalloc.get_traced_memory()[1])
        tracemalloc.stop()
    bytes_a_pose = (peaks[1] - peaks[0]) / 35_000
    print(f"{bytes_a_pose:.0f} bytes a pose")
    assert bytes_a_pose <= 2000.0
