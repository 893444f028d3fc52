"""Arm and cameras refined together, with everything known about how it went."""

from dataclasses import dataclass
from functools import cached_property

from numpy.typing import NDArray

from nico_selfmodel.estimation.bending.ladder import Ladder
from nico_selfmodel.estimation.bending.what_bends import At, arm_at
from nico_selfmodel.estimation.body.body_options import BodyOptions
from nico_selfmodel.estimation.body.workspace_accuracy import WorkspaceAccuracy, workspace_accuracy
from nico_selfmodel.estimation.cameras.board_check import BoardCheck
from nico_selfmodel.estimation.noise.hand_noise import HandNoise
from nico_selfmodel.estimation.observations.pixel_evaluation import PixelEvaluation
from nico_selfmodel.model.self_model import SelfModel
from nico_selfmodel.optimization.uncertainty import Uncertainty


@dataclass(frozen=True, eq=False)
class BodyCalibration:
    """Arm and cameras refined together, with everything known about how it went."""

    model: SelfModel
    """The self-model, in the left camera's frame."""
    start: SelfModel
    """What it was refined from, in the same frame."""
    start_label: str
    """Where the arm came from: `model` or `stereo`."""
    options: BodyOptions
    """What was asked for."""
    train: PixelEvaluation
    """The model on its own training data, outliers included."""
    test: PixelEvaluation | None
    """The model on held-out data."""
    before: PixelEvaluation
    """The start on the held-out data; on the training data where nothing was held out."""
    cross_validation: PixelEvaluation | None
    """Inlier rows beside predictions made without them; None with too few poses."""
    outliers: NDArray
    """Rows of `train` that were outliers. Boolean, shape (N,)."""
    noise: HandNoise
    """Most likely tracker noise and joint noise."""
    noise_sigmas: tuple[float, float]
    """Standard deviation of each, [px] and [rad]; inf where the data do not tell."""
    corner_sigma: float | None
    """Standard deviation of a corner's coordinate [px]; None without boards."""
    uncertainty: Uncertainty
    """Of the free parameters."""
    boards: BoardCheck | None
    """Boards rebuilt before and after."""
    board_outliers: NDArray
    """Outlier boards. Boolean, shape (V,); empty without boards."""
    scale_from: str
    """What holds the scale: `boards`, `cameras` that were fixed, or a fixed parameter's name."""
    converged: bool
    iterations: int
    seconds: float
    """Time taken, the start included."""
    ladder: Ladder
    """What may bend, and what became of it; its solutions are `TreeBend`."""

    @property
    def free(self) -> frozenset[str]:
        """Names of the parameters that were estimated."""
        return frozenset(self.uncertainty.names)

    @property
    def at(self) -> At:
        """Where the arm is at the training poses, whatever bends in it."""
        return arm_at(self.model.parameters, self.train.observations.arm)

    @cached_property
    def workspace(self) -> WorkspaceAccuracy:
        """How surely the hand is known at the training poses, and what more data would cure."""
        arm = self.train.observations.arm
        return workspace_accuracy(self.model, arm.angles / self.model.servos.radians_per_unit)
