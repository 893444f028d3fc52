"""The theory, one file per estimator: circle points, kinematics, stereo, body, tool; verdicts."""

from nico_selfmodel.estimation.adaptation import RecursiveAdaptation, WindowAdaptation
from nico_selfmodel.estimation.board_accuracy import Reconstruction
from nico_selfmodel.estimation.board_mirrors import (
    BoardMirrorCalibration,
    calibrate_board_mirrors,
)
from nico_selfmodel.estimation.body import BodyCalibration, calibrate_body
from nico_selfmodel.estimation.body_options import BodyOptions
from nico_selfmodel.estimation.camera_adjustment import CameraCalibration
from nico_selfmodel.estimation.camera_assessment import CameraAssessment
from nico_selfmodel.estimation.camera_options import CameraOptions
from nico_selfmodel.estimation.circle_points import (
    CirclePointAnalysis,
    SweepCircle,
    analyse_circle_points,
)
from nico_selfmodel.estimation.errors import ErrorStatistics
from nico_selfmodel.estimation.evaluation import Evaluation, evaluate
from nico_selfmodel.estimation.health import HealthReport, check_health
from nico_selfmodel.estimation.judging import Calibration, judge, result_of, to_json
from nico_selfmodel.estimation.kinematics import KinematicCalibration, calibrate_kinematics
from nico_selfmodel.estimation.mirror import (
    MirrorCalibration,
    calibrate_mirrors,
    evaluate_mirrors,
)
from nico_selfmodel.estimation.mirror_poses import MirrorPoses, plan_mirror_poses
from nico_selfmodel.estimation.model_verdict import judge_evaluation
from nico_selfmodel.estimation.nominal_start import NominalArm
from nico_selfmodel.estimation.observations import Observations
from nico_selfmodel.estimation.pins import Pins
from nico_selfmodel.estimation.pixel_evaluation import PixelEvaluation, evaluate_pixels
from nico_selfmodel.estimation.results.calibration_result import CalibrationResult
from nico_selfmodel.estimation.stereo import calibrate_cameras
from nico_selfmodel.estimation.tool import Rezeroing, ToolCalibration, calibrate_tool, rezero
from nico_selfmodel.estimation.verdict import Verdict
from nico_selfmodel.estimation.workspace_accuracy import WorkspaceAccuracy, workspace_accuracy

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
    "MirrorPoses",
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
    "plan_mirror_poses",
    "result_of",
    "rezero",
    "to_json",
    "workspace_accuracy",
]
