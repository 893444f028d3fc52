"""Import a two-axis positioner seen by a metrology camera: a grid of poses, full of sweeps.

What it makes lies in `examples/data/positioner_two_axis`, with licence and origin:

    python examples/04_import_positioner.py measurements.yaml positioner_two_axis
    nico-selfmodel calibrate kinematics examples/data/positioner_two_axis --out positioner
"""

import argparse
from pathlib import Path

import numpy as np
import yaml

from nico_selfmodel import Dataset, JointInfo, save_dataset


def read(path: str) -> Dataset:
    """Return records of two joint angles [rad] and a target position [m] as a data set."""
    records = yaml.safe_load(Path(path).read_text(encoding="utf-8"))
    keys = sorted(records)
    return Dataset(
        name="positioner_two_axis",
        joints=(JointInfo("tilt", "rad"), JointInfo("turn", "rad")),
        sample=np.arange(1, len(keys) + 1),
        encoders=np.array([records[key]["target_joints"] for key in keys]),
        p_WH_measured=np.array([[records[key]["pose"][a] for a in "xyz"] for key in keys]),
        source="two-axis positioner, target seen by a metrology camera; "
        "ros-industrial/industrial_calibration, Apache-2.0",
    )


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("measurements", help="measurements.yaml")
    parser.add_argument("out", help="folder of the data set to make")
    arguments = parser.parse_args()
    save_dataset(read(arguments.measurements), arguments.out)
