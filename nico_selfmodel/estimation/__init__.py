"""The theory, one file per estimator: circle points, kinematics, stereo; and the verdicts."""

from nico_selfmodel.estimation.board_accuracy import Reconstruction
from nico_selfmodel.estimation.camera_adjustment import CameraCalibration
from nico_selfmodel.estimation.camera_assessment import CameraAssessment, judge_cameras
from nico_selfmodel.estimation.camera_document import camera_document
from nico_selfmodel.estimation.camera_options import CameraOptions
from nico_selfmodel.estimation.circle_points import (
    CirclePointAnalysis,
    SweepCircle,
    analyse_circle_points,
)
from nico_selfmodel.estimation.error_statistics import ErrorStatistics, Evaluation, evaluate
from nico_selfmodel.estimation.kinematics import KinematicCalibration, calibrate_kinematics
from nico_selfmodel.estimation.nominal_start import NominalArm
from nico_selfmodel.estimation.observations import Observations
from nico_selfmodel.estimation.pins import Pins
from nico_selfmodel.estimation.result_document import parameter_table, result_document
from nico_selfmodel.estimation.stereo import calibrate_cameras
from nico_selfmodel.estimation.verdict import Verdict, judge

__all__ = [
    "CameraAssessment",
    "CameraCalibration",
    "CameraOptions",
    "CirclePointAnalysis",
    "ErrorStatistics",
    "Evaluation",
    "KinematicCalibration",
    "NominalArm",
    "Observations",
    "Pins",
    "Reconstruction",
    "SweepCircle",
    "Verdict",
    "analyse_circle_points",
    "calibrate_cameras",
    "calibrate_kinematics",
    "camera_document",
    "evaluate",
    "judge",
    "judge_cameras",
    "parameter_table",
    "result_document",
]
