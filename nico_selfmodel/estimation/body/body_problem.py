"""One adjustment of arm, cameras and boards: the program, its variances, its solution."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.dataset.board_views import BoardViews
from nico_selfmodel.errors import NotConvergedError
from nico_selfmodel.estimation.cameras.board_residuals import BoardResiduals
from nico_selfmodel.estimation.cameras.camera_initialization import pose_of_seen_boards
from nico_selfmodel.estimation.noise.hand_noise import HandNoise
from nico_selfmodel.estimation.observations.arm_views import ArmView
from nico_selfmodel.estimation.observations.hand_pixels import HandPixels
from nico_selfmodel.estimation.observations.pixel_observations import PixelObservations
from nico_selfmodel.model.cameras.stereo_rig import StereoRig
from nico_selfmodel.optimization.calibration_program import CalibrationProgram
from nico_selfmodel.optimization.robust_solve import RobustSolution, solve_robustly

FIRST_CORNER_SIGMA = 0.2
"""Noise of a corner, until it is estimated [px]."""


@dataclass(frozen=True, eq=False)
class BodySolution:
    """Where an adjustment ended."""

    arm: NDArray
    """Variables of the arm."""
    rig: StereoRig
    """The cameras, the left one at the world."""
    noise: HandNoise
    """What disturbs the hand's pixels."""
    corner_sigma: float | None
    """Standard deviation of a corner's coordinate [px]; None without boards."""
    X_LG: NDArray | None
    """Poses of the boards [m]; None without any. Shape (V, 4, 4)."""
    outliers: NDArray
    """Outlier rows. Boolean, shape (N,)."""
    converged: bool
    iterations: int
    history: tuple[float, ...]


class BodyProblem:
    """Arm, cameras and boards as one program of named variables."""

    def __init__(
        self,
        observations: PixelObservations,
        view: ArmView,
        rig: StereoRig,
        boards: BoardViews | None,
        held: Mapping[str, float | None],
        X_LG: NDArray | None = None,
    ) -> None:
        """Set up the program at a start.

        Args:
            observations: Where the cameras saw the hand.
            view: How the arm is written down.
            rig: Where the cameras start, the left one at the world.
            boards: Corners that hold scale and lenses; None to do without.
            held: Variables of arm and cameras that stay, and where; None where they are.
            X_LG: Where the boards start; by homographies if omitted. Shape (V, 4, 4).
        """
        self.observations, self._split = observations, len(view.names)
        self._image_size, self._lens = rig.left.image_size, rig.lens
        self._end = self._split + len(rig.names)
        self.hand = HandPixels(observations, view, lens=rig.lens)
        self.program = CalibrationProgram()
        self.program.add_variables(self.hand.names, np.concatenate([view.start, rig.values]))
        self._hand_number = self.program.add_residuals(self.hand)
        self.boards: BoardResiduals | None = None
        if boards is not None:
            X_LG = pose_of_seen_boards(rig.cameras, boards) if X_LG is None else X_LG
            self.boards = BoardResiduals(boards, X_LG, FIRST_CORNER_SIGMA, lens=rig.lens)
            start = self.boards.start_of(rig.cameras, X_LG)[len(rig.names) :]
            self.program.add_variables(self.boards.names[len(rig.names) :], start)
            self._board_number = self.program.add_residuals(self.boards)
        for name, value in held.items():
            self.program.fix(name, value)

    def rig_at(self, x: NDArray) -> StereoRig:
        """Return the cameras that variables describe.

        Raises:
            NotConvergedError: If they have become cameras that cannot be.
        """
        try:
            shared = x[self._split : self._end]
            return StereoRig.from_values(shared, self._image_size, self._lens)
        except ValueError as error:
            raise NotConvergedError(f"no plausible cameras fit the hand: {error}") from error

    def solve(self, noise: HandNoise, loss: str, rounds: int) -> BodySolution:
        """Alternate between the solution and the variances, then solve to the end.

        Args:
            noise: Variances to start with.
            loss: One of `optimization.robust_solve.ROBUST_METHODS`.
            rounds: Most alternations; zero keeps one pixel for every coordinate.

        Returns:
            The solution.

        Raises:
            NotConvergedError: If cameras that cannot be come out.
        """
        rough_loss = "none" if loss == "none" else "cauchy"
        iterations = 0
        for _ in range(rounds):
            self._weigh(noise)
            found = solve_robustly(self.program, self._hand_number, rough_loss, rough=True)
            iterations += found.iterations
            before, noise = noise, self._noise(found)
            if noise.close_to(before):
                break
        if rounds:
            self._weigh(noise)
        found = solve_robustly(self.program, self._hand_number, loss)
        x = found.solution.x
        corner_sigma = None if self.boards is None else self._corner_sigma(x)
        return BodySolution(
            x[: self._split],
            self.rig_at(x),
            self._noise(found),
            corner_sigma,
            None if self.boards is None else self._board_poses(x),
            found.outliers,
            found.solution.converged,
            iterations + found.iterations,
            found.solution.history,
        )

    def solve_weighed(self, noise: HandNoise | None) -> NDArray:
        """Solve roughly by plain least squares with known variances; None keeps one pixel.

        Returns:
            All variables. Shape (p,).
        """
        if noise is not None:
            self._weigh(noise)
        return self.program.solve(max_iterations=30, tolerance=1e-6).x

    def _weigh(self, noise: HandNoise) -> None:
        """Weigh hand and corners by their variances, where the program stands."""
        x = self.program.start
        slopes = self.hand.by_angle(x[: self._end])
        self.hand.whiten(noise.whitening(slopes, self.observations.seen))
        if self.boards is not None:
            self.boards.sigma = self._corner_sigma(x)

    def _noise(self, found: RobustSolution) -> HandNoise:
        """Return the most likely variances of the inlier rows."""
        x = found.solution.x[: self._end]
        pixels = self.hand.project(x)[0].T
        keep = ~found.outliers
        seen = self.observations.seen[keep]
        residuals = np.where(seen, self.observations.pixels[keep] - pixels[keep], 0.0)
        slopes = self.hand.by_angle(x)
        return HandNoise.most_likely(residuals, slopes[keep], seen, self._fitted(found)[keep])

    def _fitted(self, found: RobustSolution) -> NDArray:
        """Return what the fit itself makes the predicted pixels uncertain by [px^2]. (N, 4, 4)."""
        x, keep = found.solution.x, ~found.outliers
        spreads = self.program.prediction_covariances(self._hand_number, x)
        assert spreads is not None
        r = self.program.residuals(self._hand_number, x)[:, keep]
        taken = float(np.trace(spreads[keep], axis1=1, axis2=2).sum())
        left = max(float(self.observations.seen[keep].sum()) - taken, 1.0)
        root = np.linalg.pinv(self.hand.whitening)
        return float(np.sum(r * r)) / left * (root @ spreads @ np.swapaxes(root, 1, 2))

    def _board_poses(self, x: NDArray) -> NDArray:
        assert self.boards is not None
        return self.boards.board_poses(x[self._split :])

    def _corner_sigma(self, x: NDArray) -> float:
        """Return the spread of the corners about the boards, each board's pose discounted [px]."""
        assert self.boards is not None
        r = self.boards.sigma * self.program.residuals(self._board_number, x)
        redundancy = 2 * int(self.boards.views.seen.sum()) - 6 * len(self.boards.views)
        return max(float(np.sqrt(np.sum(r * r) / max(redundancy, 1))), 1e-3)
