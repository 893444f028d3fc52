"""Import the Franka FR3 measurements: 7 joint angles, and the camera's pose in a fixed board.

The tracked point is the camera's centre in the board's frame, the last column of its pose. There
are no sweeps in these data, and no robot description is needed: the arm is found from random axes.

What it makes lies in `examples/data/franka_fr3`, with licence and origin:

    python examples/03_import_franka.py measurements.csv franka_fr3
    nico-selfmodel calibrate kinematics examples/data/franka_fr3 --test-fraction 0.3 --out franka
"""

import argparse

from nico_selfmodel import import_csv, save_dataset

COLUMNS = {
    "joints": [
        {"name": f"joint_{i}", "column": f"q{i}_rad", "encoder_unit": "rad"} for i in range(1, 8)
    ],
    "point": {
        "x": "X_board_camera_03",
        "y": "X_board_camera_13",
        "z": "X_board_camera_23",
        "unit": "m",
    },
    "source": "Franka FR3, eye-in-hand camera before a fixed board; "
    "PhilNad/robot-arm-kinematic-calibration, MIT",
}

if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("measurements", help="measurements.csv")
    parser.add_argument("out", help="folder of the data set to make")
    arguments = parser.parse_args()
    save_dataset(import_csv(arguments.measurements, COLUMNS, name="franka_fr3"), arguments.out)
