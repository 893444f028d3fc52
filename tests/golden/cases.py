"""One calibration of each kind, from stored data: what a change that changes nothing must keep.

`python -m tests.golden.cases` writes the results anew, where a change means to change them.
"""

import json
from pathlib import Path
from typing import Any

import numpy as np

from nico_selfmodel.dataset.board_views import BoardViews
from nico_selfmodel.dataset.dataset import Dataset
from nico_selfmodel.dataset.folder import load_dataset
from nico_selfmodel.estimation.arm.kinematics import calibrate_kinematics
from nico_selfmodel.estimation.body.body import calibrate_body
from nico_selfmodel.estimation.body.body_options import BodyOptions
from nico_selfmodel.estimation.cameras.camera_assessment import CameraAssessment
from nico_selfmodel.estimation.cameras.camera_calibration import calibrate_cameras
from nico_selfmodel.estimation.judging import judge, to_json
from nico_selfmodel.estimation.mirrors.mirror import calibrate_mirrors
from nico_selfmodel.estimation.monitoring.tool import calibrate_tool, rezero
from nico_selfmodel.model.self_model_file import load_model

FOLDER = Path(__file__).parent


def data(name: str) -> Dataset:
    return load_dataset(FOLDER / name)


def boards(name: str) -> BoardViews:
    with np.load(FOLDER / f"{name}.npz") as stored:
        names, cameras = tuple(stored["names"].tolist()), tuple(stored["eyes"].tolist())
        width, height = stored["size"].tolist()
        return BoardViews(
            stored["p_GQ"], names, cameras, stored["pixels"], ((width, height),) * len(cameras)
        )


def arm() -> dict[str, Any]:
    train, test = data("arm").split(0.3, 1)
    found = calibrate_kinematics(train, test=test)
    return to_json(found, judge(found))


def cameras() -> dict[str, Any]:
    views = boards("boards")
    train, test = views.select(np.arange(12)), views.select(np.arange(12, 16))
    found = CameraAssessment.from_calibration(calibrate_cameras(train), None, test)
    return to_json(found, judge(found))


def body_model():
    cameras = load_model(FOLDER / "eyes.yaml")
    options, test = BodyOptions(), data("body_test")
    return calibrate_body(data("body_train"), cameras, boards("body_boards"), options, test=test)


def body() -> dict[str, Any]:
    found = body_model()
    return to_json(found, judge(found))


def tool() -> dict[str, Any]:
    found = calibrate_tool(body_model().model, data("tool"))
    return to_json(found, judge(found))


def rezeroed() -> dict[str, Any]:
    found = rezero(body_model().model, data("rezero"))
    return to_json(found, judge(found))


def mirror() -> dict[str, Any]:
    model = load_model(FOLDER / "mirror_body.yaml")
    found = calibrate_mirrors(data("mirror"), model, test=data("mirror_test"))
    return to_json(found, judge(found))


CASES = {
    "arm": arm,
    "cameras": cameras,
    "body": body,
    "tool": tool,
    "rezeroed": rezeroed,
    "mirror": mirror,
}


def stored(name: str) -> Path:
    return FOLDER / f"{name}.result.json"


if __name__ == "__main__":
    for name, case in CASES.items():
        text = json.dumps(case(), indent=1, allow_nan=False, sort_keys=True)
        stored(name).write_text(text + "\n")
