"""Reading a large recording of a body, beside what numpy takes for its numbers alone."""

import numpy as np
import pytest

from nico_selfmodel.dataset.body.body_dataset import BodyDataset, ObservationTable
from nico_selfmodel.dataset.body.body_folder import load_body_dataset, save_body_dataset
from nico_selfmodel.dataset.body.link_joint import LinkJoint
from nico_selfmodel.dataset.body.sensors import MarkerInfo, SensorInfo

from .timing import best_ratio

pytestmark = pytest.mark.benchmark
ROWS = 50_000


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Return a recording of six joints and one marker."""
    rng, joints = np.random.default_rng(0), "abcdef"
    nothing = np.full(ROWS, -1)
    values = np.full((ROWS, 6), np.nan)
    values[:, :3] = rng.normal(size=(ROWS, 3))
    data = BodyDataset(
        "large",
        tuple(
            LinkJoint(name, parent, "revolute", "rad")
            for name, parent in zip(joints, ("world", *joints), strict=False)
        ),
        (MarkerInfo("hand", "f"),),
        (SensorInfo("mocap", "points", "world"),),
        np.arange(ROWS),
        rng.uniform(-1.0, 1.0, (ROWS, 6)),
        ObservationTable(
            np.arange(ROWS), nothing + 1, nothing + 1, nothing, values, np.full(ROWS, "")
        ),
    )
    made = tmp_path_factory.mktemp("reading") / "large"
    save_body_dataset(data, made)
    return made


def test_a_recording_is_read_in_a_few_times_what_its_numbers_take(folder):
    def numbers():
        np.loadtxt(folder / "poses.csv", delimiter=",", skiprows=1)
        np.loadtxt(folder / "observations.csv", delimiter=",", skiprows=1, usecols=(0, 3, 4, 5))

    ratio = best_ratio(lambda: load_body_dataset(folder), numbers, rounds=3)
    print(f"{ratio:.2f} times the time of numpy's loadtxt")
    assert ratio <= 4.0
