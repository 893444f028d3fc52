"""The theory, one file per estimator: circle points, kinematics, and what is thought of them."""

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
from nico_selfmodel.estimation.verdict import Verdict, judge

__all__ = [
    "CirclePointAnalysis",
    "ErrorStatistics",
    "Evaluation",
    "KinematicCalibration",
    "NominalArm",
    "Observations",
    "Pins",
    "SweepCircle",
    "Verdict",
    "analyse_circle_points",
    "calibrate_kinematics",
    "evaluate",
    "judge",
    "parameter_table",
    "result_document",
]
