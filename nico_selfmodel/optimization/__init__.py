"""How any estimate is solved for: programs, solvers, losses, uncertainty. Nothing of robots."""

from nico_selfmodel.optimization.calibration_program import CalibrationProgram, ProgramSolution
from nico_selfmodel.optimization.losses import Loss, robust_scale
from nico_selfmodel.optimization.residual_block import ResidualBlock
from nico_selfmodel.optimization.robust_solve import RobustSolution, solve_robustly
from nico_selfmodel.optimization.uncertainty import BlindDirection, Uncertainty

__all__ = [
    "BlindDirection",
    "CalibrationProgram",
    "Loss",
    "ProgramSolution",
    "ResidualBlock",
    "RobustSolution",
    "Uncertainty",
    "robust_scale",
    "solve_robustly",
]
