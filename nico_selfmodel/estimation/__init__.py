"""The theory, one file per estimator: circle points, kinematics, stereo, body, tool; verdicts."""

from nico_selfmodel.estimation.arm.evaluation import Evaluation, evaluate
from nico_selfmodel.estimation.arm.kinematics import KinematicCalibration, calibrate_kinematics
from nico_selfmodel.estimation.body.body import BodyCalibration, calibrate_body
from nico_selfmodel.estimation.body.body_options import BodyOptions
from nico_selfmodel.estimation.body.workspace_accuracy import (
    WorkspaceAccuracy,
    workspace_accuracy,
)
from nico_selfmodel.estimation.cameras.board_accuracy import Reconstruction
from nico_selfmodel.estimation.cameras.camera_adjustment import CameraCalibration
from nico_selfmodel.estimation.cameras.camera_assessment import CameraAssessment
from nico_selfmodel.estimation.cameras.camera_options import CameraOptions
from nico_selfmodel.estimation.cameras.stereo import calibrate_cameras
from nico_selfmodel.estimation.initialization.circle_points import (
    CirclePointAnalysis,
    SweepCircle,
    analyse_circle_points,
)
from nico_selfmodel.estimation.initialization.nominal_arm import NominalArm
from nico_selfmodel.estimation.judging import Calibration, judge, result_of, to_json
from nico_selfmodel.estimation.mirrors.board_mirrors import (
    BoardMirrorCalibration,
    calibrate_board_mirrors,
)
from nico_selfmodel.estimation.mirrors.mirror import (
    MirrorCalibration,
    calibrate_mirrors,
    evaluate_mirrors,
)
from nico_selfmodel.estimation.model_verdict import judge_evaluation
from nico_selfmodel.estimation.monitoring.adaptation import RecursiveAdaptation, WindowAdaptation
from nico_selfmodel.estimation.monitoring.health import HealthReport, check_health
from nico_selfmodel.estimation.monitoring.tool import (
    Rezeroing,
    ToolCalibration,
    calibrate_tool,
    rezero,
)
from nico_selfmodel.estimation.observations.observations import Observations
from nico_selfmodel.estimation.observations.pixel_evaluation import (
    PixelEvaluation,
    evaluate_pixels,
)
from nico_selfmodel.estimation.results.calibration_result import CalibrationResult
from nico_selfmodel.estimation.results.errors import ErrorStatistics
from nico_selfmodel.estimation.results.fixed_parameters import Pins
from nico_selfmodel.estimation.results.verdict import Verdict

__all__ = [
    "BoardMirrorCalibration",
    "BodyCalibration",
    "BodyOptions",
    "Calibration",
    "CalibrationResult",
    "CameraAssessment",
    "CameraCalibration",
    "CameraOptions",
    "CirclePointAnalysis",
    "ErrorStatistics",
    "Evaluation",
    "HealthReport",
    "KinematicCalibration",
    "MirrorCalibration",
    "NominalArm",
    "Observations",
    "Pins",
    "PixelEvaluation",
    "Reconstruction",
    "RecursiveAdaptation",
    "Rezeroing",
    "SweepCircle",
    "ToolCalibration",
    "Verdict",
    "WindowAdaptation",
    "WorkspaceAccuracy",
    "analyse_circle_points",
    "calibrate_board_mirrors",
    "calibrate_body",
    "calibrate_cameras",
    "calibrate_kinematics",
    "calibrate_mirrors",
    "calibrate_tool",
    "check_health",
    "evaluate",
    "evaluate_mirrors",
    "evaluate_pixels",
    "judge",
    "judge_evaluation",
    "result_of",
    "rezero",
    "to_json",
    "workspace_accuracy",
]
