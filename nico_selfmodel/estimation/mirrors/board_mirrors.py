"""Calibrate a camera and mirrors from boards that it sees directly and in the mirrors."""

import time
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.dataset.mirrored_boards import MirroredBoards
from nico_selfmodel.errors import (
    DataError,
    EstimationError,
    NotConvergedError,
    NotIdentifiableError,
)
from nico_selfmodel.estimation.cameras.camera_adjustment import (
    OUTLIER_RATIO,
    SUSPICIOUS,
    natural_scales,
)
from nico_selfmodel.estimation.cameras.camera_calibration import FEWEST_VIEWS, calibrate_cameras
from nico_selfmodel.estimation.cameras.camera_initialization import pose_of_seen_boards
from nico_selfmodel.estimation.cameras.camera_options import CameraOptions
from nico_selfmodel.estimation.mirrors.board_mirror_initialization import board_mirror_start
from nico_selfmodel.estimation.mirrors.board_mirror_residuals import BoardMirrorResiduals
from nico_selfmodel.estimation.results.provenance import package_versions
from nico_selfmodel.model.cameras.camera import Camera
from nico_selfmodel.model.cameras.mirror import Mirror, plane_of_values
from nico_selfmodel.model.self_model import ParameterCovariance, SelfModel
from nico_selfmodel.optimization.calibration_program import CalibrationProgram
from nico_selfmodel.optimization.robust_solve import RobustSolution, solve_robustly
from nico_selfmodel.optimization.uncertainty import Uncertainty

_LARGEST_MISFIT, _LARGEST_RATIO = 3.0, 8.0
"""Reflections that fit worse than this [px], and than so many times the direct views, are none."""


@dataclass(frozen=True, eq=False)
class BoardMirrorCalibration:
    """A camera and mirrors learned from boards."""

    boards: MirroredBoards
    """What was given."""
    camera: Camera
    """The camera, at the world."""
    mirrors: Mapping[str, Mirror]
    """The mirrors with their covariance, in the camera's frame."""
    X_LG: NDArray
    """Pose of the board in each photograph [m]. Shape (V, 4, 4)."""
    residuals: NDArray
    """Measured minus predicted pixels, nan where not seen [px]. Shape (V, 1 + M, P, 2)."""
    outliers: NDArray
    """Photographs that were outliers. Boolean, shape (V,)."""
    uncertainty: Uncertainty
    """Of the free parameters of camera and mirrors, with the boards free."""
    converged: bool
    """Whether the solver reached a minimum."""
    iterations: int
    """Of the last adjustment."""
    seconds: float
    """Time of the whole estimation."""

    @property
    def distances(self) -> NDArray:
        """Reprojection error of each corner each way, nan where not seen [px]. (V, 1 + M, P)."""
        return np.linalg.norm(self.residuals, axis=3)

    @property
    def rms(self) -> float:
        """Root mean square error of the inlier photographs, as OpenCV counts it [px]."""
        return float(np.sqrt(np.nanmean(self.distances[~self.outliers] ** 2)))

    def angle_between(self, first: str, second: str) -> tuple[float, float]:
        """Return the angle between two mirrors' normals and its standard deviation [rad]."""
        one, other = self.mirrors[first], self.mirrors[second]
        angle = one.angle_to(other)
        names, slope = self.uncertainty.names, np.zeros(len(self.uncertainty.names))
        for name, here, there in ((first, one, other), (second, other, one)):
            by_values = plane_of_values(here.values)[1][:3]
            # cos a = n1.n2, so da = -(n2.dn1 + n1.dn2) / sin a
            columns = [names.index(n) for n in Mirror.names_of(name)]
            slope[columns] = -(there.normal @ by_values) / np.sin(angle)
        return angle, float(np.sqrt(slope @ self.uncertainty.covariance @ slope))

    def self_model(self, name: str, provenance: Mapping[str, Any] | None = None) -> SelfModel:
        """Return the camera and the mirrors as a self-model without an arm.

        Args:
            name: What it is called.
            provenance: Where it comes from.
        """
        inliers = self.distances[~self.outliers]
        sigma = float(np.sqrt(self.uncertainty.variance_factor))
        return SelfModel(
            name,
            covariance=ParameterCovariance(self.uncertainty.names, self.uncertainty.covariance),
            fit={"boards": len(inliers), "rms_px": self.rms},
            provenance={**(provenance or {}), **package_versions()},
            cameras={self.boards.camera: self.camera},
            pixel_sigma=sigma,
            mirrors=self.mirrors,
        )


def calibrate_board_mirrors(
    boards: MirroredBoards, options: CameraOptions | None = None
) -> BoardMirrorCalibration:
    """Adjust one camera's lens, the planes of all mirrors and the boards' poses together.

    Reflections are far away and at other angles: they add to what is known of the lens.

    Args:
        boards: Corners seen directly and in mirrors.
        options: What of the lens is held and free, as in `calibrate_cameras`. `aspect` and priors
            are not supported here.

    Returns:
        Lens, mirrors, boards and what is known of them.

    Raises:
        DataError: If a mirror cannot be one.
        EstimationError: If the reflections do not fit together with the direct views.
        NotConvergedError: If a camera or a mirror that cannot be comes out.
        NotIdentifiableError: If too few boards are seen directly, or none also in some mirror.
        ValueError: If an option names no parameter or is not supported.
    """
    began = time.perf_counter()
    options = options or CameraOptions()
    if options.aspect is not None or options.priors:
        raise ValueError("aspect and priors are not supported with boards in mirrors")
    boards = boards.select(boards.ways.any(axis=1))
    direct = boards.directly()
    if len(direct) < FEWEST_VIEWS:
        raise NotIdentifiableError(
            f"{len(direct)} photographs show the board directly, at least {FEWEST_VIEWS} in "
            "different attitudes are needed"
        )
    alone = calibrate_cameras(direct, options)
    (camera,) = alone.cameras
    mirrors, X_LG = board_mirror_start(boards, camera)
    if np.isnan(X_LG).any():
        raise DataError("a photograph shows the board neither directly nor in a mirror")
    block = BoardMirrorResiduals(boards, X_LG)
    program = CalibrationProgram()
    program.add_variables(block.names, block.start_of(camera, mirrors, X_LG))
    number = program.add_residuals(block)
    for name, value in options.held(block.camera_names).items():
        program.fix(name, value)
    found = _solve(program, number, block, options.loss)
    result = _result(boards, block, program, found, began)
    if result.rms > max(_LARGEST_MISFIT, _LARGEST_RATIO * alone.rms):
        raise EstimationError(
            f"direct views fit to {alone.rms:.2f} px, but together with the reflections only to "
            f"{result.rms:.1f} px: are corners in reflections listed in the board's own order, are "
            "the mirrors flat, and did they keep still?",
            partial=result,
        )
    return result


def place_boards(boards: MirroredBoards, camera: Camera) -> tuple[NDArray, NDArray]:
    """Place boards before a calibrated camera by their direct views alone.

    Args:
        boards: Corners; every photograph shows the board directly.
        camera: The camera, at the world.

    Returns:
        X_LG, shape (V, 4, 4), and the covariance of turn (about axes of L) and place of each for
        corners of one pixel, shape (V, 6, 6).
    """
    direct = boards.directly()
    if len(direct) != len(boards):
        raise DataError("every photograph must show the board directly")
    alone = MirroredBoards(
        boards.p_GQ, boards.names, (), boards.pixels[:, :1], boards.image_size, boards.camera
    )
    X_LG = pose_of_seen_boards((camera,), direct)
    block = BoardMirrorResiduals(alone, X_LG)
    program = CalibrationProgram()
    program.add_variables(block.names, block.start_of(camera, (), X_LG))
    program.add_residuals(block)
    for name in block.shared_names:
        program.fix(name)
    x = program.solve().x
    # About where the boards were found the chart's turn is that about the axes of L.
    settled = BoardMirrorResiduals(alone, block.board_poses(x))
    own = settled.evaluate_parts(settled.start_of(camera, (), block.board_poses(x)))[2]
    return block.board_poses(x), np.linalg.inv(own @ np.swapaxes(own, 1, 2))


def _solve(
    program: CalibrationProgram, number: int, block: BoardMirrorResiduals, loss: str
) -> RobustSolution:
    """Least squares; where a photograph stands out and the loss allows, once more without it."""
    found = solve_robustly(program, number, "none")
    squares = np.sum(program.residuals(number, found.solution.x) ** 2, axis=0)
    rms = np.sqrt(squares / block.boards.seen.sum(axis=(1, 2)))
    if loss == "none" or (loss == "trimmed" and not (rms > SUSPICIOUS * np.median(rms)).any()):
        return found
    return solve_robustly(program, number, loss, outlier_at=OUTLIER_RATIO * np.sqrt(3.0))


def _result(
    boards: MirroredBoards,
    block: BoardMirrorResiduals,
    program: CalibrationProgram,
    found: RobustSolution,
    began: float,
) -> BoardMirrorCalibration:
    """Gather what is known at the solution."""
    x, inliers = found.solution.x, ~found.outliers
    parts = block.evaluate_parts(x)
    uncertainty = _uncertainty(block, program, x, inliers)
    mirrors = {}
    try:
        camera = block.camera(x)
        for name, values in zip(boards.mirrors, block.planes(x), strict=True):
            columns = [uncertainty.names.index(n) for n in Mirror.names_of(name)]
            covariance = uncertainty.covariance[np.ix_(columns, columns)]
            mirrors[name] = Mirror.from_values(values, covariance)
    except ValueError as error:
        raise NotConvergedError(f"no plausible camera and mirrors fit: {error}") from error
    return BoardMirrorCalibration(
        boards,
        camera,
        mirrors,
        block.board_poses(x),
        block.pixel_residuals(parts[0]),
        found.outliers,
        uncertainty,
        found.solution.converged,
        found.iterations,
        time.perf_counter() - began,
    )


def _uncertainty(
    block: BoardMirrorResiduals, program: CalibrationProgram, x: NDArray, inliers: NDArray
) -> Uncertainty:
    """Return the covariance of the free parameters of camera and mirrors, boards eliminated."""
    parts = block.evaluate_parts(x)
    names = block.shared_names
    columns = np.flatnonzero(program.free[: len(names)])
    free = tuple(names[i] for i in columns)
    jacobian = block.reduced_jacobian(parts, inliers.astype(float))[:, columns]
    lens = tuple(name for name in free if name in block.camera_names)
    natural = natural_scales(lens, block.boards.directly(), x[: len(names)], names)
    planes = [(1.0, 1.0, max(values[2], 1e-3)) for values in block.planes(x).tolist()]
    scales = np.concatenate([natural, np.ravel(planes)])
    redundancy = 2 * int(block.boards.seen[inliers].sum()) - 6 * int(inliers.sum())
    squares = float(np.sum(parts[0][inliers] ** 2))
    return Uncertainty.from_jacobian(free, jacobian, scales, squares, redundancy)
