"""Any calibration: its result, the verdict on it, and what goes into `result.json`."""

from typing import TYPE_CHECKING, Any

from nico_selfmodel.estimation.results.calibration_result import CalibrationResult, Errors
from nico_selfmodel.estimation.results.judge import verdict_on
from nico_selfmodel.estimation.results.verdict import Verdict

if TYPE_CHECKING:
    from nico_selfmodel.estimation.arm.kinematics import KinematicCalibration
    from nico_selfmodel.estimation.body.body_calibration import BodyCalibration
    from nico_selfmodel.estimation.cameras.camera_assessment import CameraAssessment
    from nico_selfmodel.estimation.mirrors.mirror import MirrorCalibration
    from nico_selfmodel.estimation.monitoring.body_relearning import BodyUpdate
    from nico_selfmodel.estimation.monitoring.tool import Rezeroing, ToolCalibration
    from nico_selfmodel.estimation.response.servo_calibration import ServoCalibration
    from nico_selfmodel.estimation.tree.tree_calibration import TreeCalibration

    Calibration = (
        KinematicCalibration
        | BodyCalibration
        | CameraAssessment
        | MirrorCalibration
        | ToolCalibration
        | Rezeroing
        | TreeCalibration
        | BodyUpdate
        | ServoCalibration
        | CalibrationResult
    )
    """Whatever was learned, or its result."""


def result_of(calibration: "Calibration") -> CalibrationResult:
    """Return a calibration in the form in which all are judged and written down.

    Who learned an arm does not wait for the modules of all else that could have been learned.

    Args:
        calibration: What was learned: an arm, cameras, a body, mirrors, a tool, new zeros, servos.

    Raises:
        TypeError: If it is none of these.
    """
    found: Any = calibration
    if isinstance(found, CalibrationResult):
        return found
    match type(found).__name__:
        case "KinematicCalibration":
            from nico_selfmodel.estimation.arm.arm_result import arm_result as result
        case "BodyCalibration":
            from nico_selfmodel.estimation.body.body_result import body_result as result
        case "CameraAssessment":
            from nico_selfmodel.estimation.cameras.camera_result import camera_result as result
        case "MirrorCalibration":
            from nico_selfmodel.estimation.mirrors.mirror_result import mirror_result as result
        case "ToolCalibration":
            from nico_selfmodel.estimation.monitoring.update_result import tool_result as result
        case "Rezeroing":
            from nico_selfmodel.estimation.monitoring.update_result import rezero_result as result
        case "TreeCalibration":
            from nico_selfmodel.estimation.tree.tree_result import tree_result as result
        case "BodyUpdate":
            from nico_selfmodel.estimation.monitoring.body_update_result import (
                body_update_result as result,
            )
        case "ServoCalibration":
            from nico_selfmodel.estimation.response.servo_result import servo_result as result
        case other:
            raise TypeError(f"a {other} is no calibration, nor a result of one")
    return result(found)


def judge(
    calibration: "Calibration",
    require_test_mm: float | None = None,
    require_test_px: float | None = None,
) -> Verdict:
    """Judge a calibration.

    Args:
        require_test_mm: Largest held-out error in space allowed: the mean [mm].
        require_test_px: Largest held-out error in the images allowed: the mean, of boards the root
            mean square [px].

    Returns:
        FAIL where a check fails; NOT_EVALUATED where too little was held out, or what was asked is
        left open; else PASS.
    """
    return verdict_on(result_of(calibration), require_test_mm, require_test_px)


def to_json(calibration: "Calibration", verdict: Verdict) -> dict[str, Any]:
    """Return the content of `result.json`; numbers that do not exist are null."""
    result = result_of(calibration)
    return {
        "status": verdict.status,
        "reasons": list(verdict.reasons),
        "warnings": list(verdict.warnings),
        "method": result.method,
        "train": _block(result.train),
        "test": _block(result.test),
        "cross_validation": _block(result.cross_validation),
        "parameters": {name: known.to_json() for name, known in result.parameters.items()},
        "not_identifiable": list(result.unobservable),
        "outliers": list(result.outlier_names),
        **result.details,
        "seconds": result.seconds,
        "iterations": result.iterations,
        "converged": result.converged,
    }


def _block(errors: Errors | None) -> dict[str, Any] | None:
    return None if errors is None else errors.to_json()
