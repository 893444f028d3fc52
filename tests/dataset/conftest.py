"""A small data set with something in every column, and a folder that holds it as text."""

from pathlib import Path

import numpy as np
import pytest

from nico_selfmodel.dataset.dataset import Dataset
from nico_selfmodel.dataset.joint_info import JointInfo

METADATA = """\
format: nico-dataset/1
name: bench
joints:
  - {name: shoulder, encoder_unit: counts, counts_per_turn: 4096}
  - {name: elbow, encoder_unit: deg, lower: -5, upper: 120}
"""

SAMPLES = """\
sample,sweep,marker,encoder.shoulder,encoder.elbow,x_m,y_m,z_m,note
1,home,hand,100,40.5,0.25,0.1,0.3,start
2,shoulder,hand,300,40.5,0.2,0.2,0.3,
3,shoulder,hand,500,40.5,0.1,0.25,0.3,"slow, twice"
4,elbow,hand,100,60,0.2,0.1,0.4,
5,elbow,hand,100,80,,,,hidden
6,,hand,220,15,0.27,0.15,0.2,
"""


@pytest.fixture
def folder(tmp_path):
    """Return a function that writes a data set from its two texts and returns its folder."""

    def write(samples: str = SAMPLES, metadata: str = METADATA) -> Path:
        path = tmp_path / "data"
        path.mkdir(exist_ok=True)
        (path / "dataset.yaml").write_bytes(metadata.encode())
        (path / "samples.csv").write_bytes(samples.encode())
        return path

    return write


@pytest.fixture
def joints():
    return (
        JointInfo("shoulder", "counts", counts_per_turn=4096),
        JointInfo("elbow", "deg", lower=-5, upper=120, sign=-1),
    )


@pytest.fixture
def dataset(joints):
    """Home, a sweep of each joint and four free poses; two markers a pose, one hidden once."""
    sweep = np.repeat(["home", "shoulder", "shoulder", "elbow", "elbow", "", "", "", ""], 2)
    poses = [[0, 10], [90, 10], [180, 10], [0, 50], [0, 90], [7, 1], [28, 2], [49, 3], [70, 4]]
    rng = np.random.default_rng(3)
    points = rng.normal(0.0, 0.1, (18, 3))
    points[5] = np.nan
    pixels = np.full((18, 4), np.nan)
    pixels[3], pixels[4, :2] = [1.5, 2.25, 3.0, 1 / 3], [10.0, 20.0]
    return Dataset(
        name="two markers",
        joints=joints,
        sample=np.repeat(np.arange(9) + 11, 2),
        encoders=np.repeat(np.array(poses, float), 2, axis=0),
        p_WH_measured=points,
        sweep=sweep,
        marker=np.tile(["wrist", "finger"], 9),
        pixels=pixels,
        point_sigma_m=0.0003,
        pixel_sigma_px=0.2,
        image_size=(640, 480),
        cameras={"left": {"file": "left.png", "gain": 1e-7}},
        source="made up\nfor tests: 1\x85 \u2028\ttoo",
        seed=5,
        extra={"note": tuple(f'no. {i}, "x"\r\n' for i in range(18))},
    )
