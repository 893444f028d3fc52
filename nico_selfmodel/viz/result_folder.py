"""The folders that calibrations leave behind."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from nico_selfmodel.dataset import Dataset
from nico_selfmodel.errors import DataError, ModelError
from nico_selfmodel.estimation import CameraAssessment, KinematicCalibration, Verdict, to_json
from nico_selfmodel.files import refuse_folder
from nico_selfmodel.files.reading import LARGEST_SCENE, read_text
from nico_selfmodel.model import SelfModel
from nico_selfmodel.plant import ArmDescription
from nico_selfmodel.viz.camera_report import camera_report_html
from nico_selfmodel.viz.camera_scene import camera_scene
from nico_selfmodel.viz.folder import SCENE_FILE, shown, urdf_file, write_folder
from nico_selfmodel.viz.kinematics_scene import calibration_scene
from nico_selfmodel.viz.photographs import Photographs
from nico_selfmodel.viz.report import report_html
from nico_selfmodel.viz.scene import Scene


def write_result_folder(
    folder: str | Path,
    calibration: KinematicCalibration,
    verdict: Verdict,
    document: Mapping[str, Any] | None = None,
    *,
    urdf_text: str | None = None,
    robot_name: str | None = None,
    robot: ArmDescription | None = None,
    recordings: Mapping[str, Dataset] | None = None,
    force: bool = False,
) -> Path:
    """Write `self_model.yaml`, `result.json`, `report.html`, `scene.json` and the URDF, or nothing.

    Args:
        folder: The folder to make.
        calibration: What was learned.
        verdict: What is thought of it.
        document: `result_document` of both, with what else `result.json` should tell.
        urdf_text: The learned URDF, written as `<robot>_learned.urdf`.
        robot_name: Name of the robot; the self-model's if omitted.
        robot: The robot that the arm belongs to, to be drawn in the scene.
        recordings: Data sets to keep beside the result, in `recordings/<name>`.
        force: Replace an existing folder.

    Returns:
        The folder.

    Raises:
        FileExistsError: If the folder exists and `force` is not set.
        OSError: If it cannot be written.
        ModelError: If the robot cannot be read, or its chain has other joints.
        SelfModelError: If the server that makes the interactive scene cannot start.
    """
    folder = Path(folder)
    refuse_folder(folder, force=force)
    document = to_json(calibration, verdict) if document is None else document
    scene = calibration_scene(calibration, robot)
    texts = shown(report_html(calibration, verdict, document, scene), scene)
    if urdf_text is not None:
        texts[urdf_file(robot_name or calibration.model.name)] = urdf_text
    return write_folder(folder, calibration.model, document, texts, recordings, force=force)


def write_camera_folder(
    folder: str | Path,
    assessment: CameraAssessment,
    verdict: Verdict,
    document: Mapping[str, Any] | None = None,
    *,
    model: SelfModel,
    images: Photographs | None = None,
    force: bool = False,
) -> Path:
    """Write `self_model.yaml`, `result.json`, `report.html` and `scene.json`, or nothing.

    Args:
        folder: The folder to make.
        assessment: What was learned of the cameras and what it is worth.
        verdict: What is thought of it.
        document: `camera_document` of both, with what else `result.json` should tell.
        model: The self-model with these cameras.
        images: Photographs: eye -> view -> red, green and blue.
        force: Replace an existing folder.

    Returns:
        The folder.

    Raises:
        FileExistsError: If the folder exists and `force` is not set.
        OSError: If it cannot be written.
        SelfModelError: If the server that makes the interactive scene cannot start.
        ValueError: If an image is not one, or not of the size that was calibrated.
    """
    folder = Path(folder)
    refuse_folder(folder, force=force)
    document = to_json(assessment, verdict) if document is None else document
    scene = camera_scene(assessment, images, name=model.name)
    report = camera_report_html(assessment, verdict, document, images, scene, model=model)
    return write_folder(folder, model, document, shown(report, scene), force=force)


def load_scene(result: str | Path) -> Scene:
    """Read the scene of a result folder, so that it can be drawn without learning again.

    Args:
        result: The folder, or its `scene.json`.

    Returns:
        The scene.

    Raises:
        ModelError: If there is none, or it is not valid.
    """
    path = Path(result)
    path = path / SCENE_FILE if path.is_dir() else path
    if not path.exists():
        raise ModelError(
            f"{path} does not exist: give the folder that `calibrate` or `learn` wrote"
        )
    try:
        text = read_text(path, LARGEST_SCENE)
    except DataError as error:
        reason = str(error).removeprefix(f"{path}: ").removeprefix("cannot be read: ")
        raise ModelError(f"{path} cannot be read: {reason}") from error
    try:
        return Scene.from_json(text)
    except ModelError as error:
        raise ModelError(f"{path}: {error}") from error
