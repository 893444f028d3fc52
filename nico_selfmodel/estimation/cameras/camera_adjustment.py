"""One adjustment of cameras and all boards, its result and its uncertainty."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.dataset.board_views import BoardViews
from nico_selfmodel.errors import NotConvergedError
from nico_selfmodel.estimation.cameras.board_residuals import BoardResiduals
from nico_selfmodel.estimation.cameras.camera_options import CameraOptions, by_full_name
from nico_selfmodel.estimation.cameras.corner_noise import corner_noise
from nico_selfmodel.estimation.results.provenance import package_versions
from nico_selfmodel.model.cameras.camera import Camera
from nico_selfmodel.model.cameras.projection import RATIONAL
from nico_selfmodel.model.cameras.stereo_rig import StereoRig
from nico_selfmodel.model.self_model import ParameterCovariance, SelfModel
from nico_selfmodel.optimization.calibration_program import CalibrationProgram
from nico_selfmodel.optimization.losses import Loss
from nico_selfmodel.optimization.robust_solve import RobustSolution, solve_robustly, solve_without
from nico_selfmodel.optimization.separable_block import Parts
from nico_selfmodel.optimization.uncertainty import Uncertainty

OUTLIER_RATIO = 10.0
"""A board whose rms is this many times the rest's is called an outlier."""
_LOOSE = 100.0
"""How much more uncertain than others a coefficient of a rational lens is before it counts."""
_RATIONAL = 10.0
"""Standard deviation of k4, k5, k6 about 0, in units of what they do at the image's corner."""
_SHARP = 0.02
"""Share by which a pixel's standard deviation may be off where priors are weighed."""
_ROUNDS = 4
"""Solutions after which it is taken as it is: which boards are outliers may go to and fro."""
_EXACT = 1e-9
"""Standard deviation of corners without noise [px]."""
_PER_PARAMETER = 20
"""Residuals for each parameter from which on they tell how they scatter one by one."""
_ALMOST_NONE = 1e-9
"""Share of a pose's own information that no one misses, and that makes any of it invertible."""
FEWEST_ALONE = 16
"""Corners of a board from which on one camera by itself tells how well they fit."""
SUSPICIOUS = 3.0
"""A board whose rms is this many times the median one makes a robust solution worth its time."""


@dataclass(frozen=True, eq=False)
class CameraCalibration:
    """Cameras learned from boards."""

    views: BoardViews
    """What was given."""
    cameras: tuple[Camera, ...]
    """The cameras, in the order of `views.cameras`, in the frame of the first."""
    X_LG: NDArray
    """Pose of the board in each view, in the frame of the first camera [m]. Shape (V, 4, 4)."""
    residuals: NDArray
    """Measured minus predicted pixels, nan where not seen [px]. Shape (V, P, 2 C)."""
    outliers: NDArray
    """Views that were outliers. Boolean, shape (V,)."""
    names: tuple[str, ...]
    """Camera parameters that were free."""
    uncertainty: Uncertainty
    """Of the free camera parameters, with the boards free."""
    pixel_sigma: float
    """Standard deviation of a pixel coordinate about the model [px]."""
    cost: float
    """Half the sum of squared residuals of the inlier views [px^2]."""
    converged: bool
    """Whether the solver reached a minimum."""
    iterations: int
    """Of the last adjustment."""
    seconds: float
    """Time of the whole estimation."""
    view_alone: NDArray = field(default_factory=lambda: np.zeros((0, 0, 2)))
    """Sums of squares of what each camera saw of each board, at the pose that fits all cameras and
    at its own, [px^2]; nan where a few corners tell nothing. Shape (V, C, 2)."""

    @property
    def rig(self) -> StereoRig:
        """Both cameras.

        Raises:
            ValueError: If there are others than two.
        """
        if len(self.cameras) != 2:
            raise ValueError(f"a stereo rig has two cameras, got {len(self.cameras)}")
        return StereoRig(*self.cameras)

    def pair(self, first: str, second: str) -> StereoRig:
        """Return two of the cameras, the first one as the left."""
        by_name = dict(zip(self.views.cameras, self.cameras, strict=True))
        return StereoRig(by_name[first], by_name[second])

    def self_model(self, name: str, provenance: Mapping[str, Any] | None = None) -> SelfModel:
        """Return the cameras as a self-model without an arm."""
        return SelfModel(
            name,
            covariance=ParameterCovariance(self.names, self.uncertainty.covariance),
            fit={"boards": int((~self.outliers).sum()), "rms_px": self.rms},
            provenance={**(provenance or {}), **package_versions("opencv-python-headless")},
            cameras=dict(zip(self.views.cameras, self.cameras, strict=True)),
            pixel_sigma=self.pixel_sigma,
        )

    @property
    def distances(self) -> NDArray:
        """Reprojection error of each corner in each camera, nan where not seen [px]. (V, C, P)."""
        r = self.residuals.reshape(*self.residuals.shape[:2], len(self.cameras), 2)
        return np.moveaxis(np.linalg.norm(r, axis=3), 2, 1)

    @property
    def view_rms(self) -> NDArray:
        """Root mean square error of each view, over its cameras [px]. Shape (V,)."""
        return np.sqrt(np.nanmean(self.distances**2, axis=(1, 2)))

    @property
    def rms(self) -> float:
        """Root mean square error of the inlier views, as OpenCV counts it [px]."""
        return float(np.sqrt(np.nanmean(self.distances[~self.outliers] ** 2)))


class Adjustment:
    """One adjustment of cameras and boards under way."""

    def __init__(
        self,
        views: BoardViews,
        cameras: tuple[Camera, ...],
        X_LG: NDArray,
        options: CameraOptions,
    ) -> None:
        """Set up the program at a start."""
        self.views = views
        lenses = options.lenses(views.cameras)
        self.block = BoardResiduals(views, X_LG, 1.0, options.aspect, lenses)
        self.program = CalibrationProgram()
        self.program.add_variables(self.block.names, self.block.start_of(cameras, X_LG))
        self.number = self.program.add_residuals(self.block)
        self.held = options.held(self.block.shared_names)
        for name, value in self.held.items():
            self.program.fix(name, value)
        self.stated = by_full_name(options.priors, self.block.shared_names)
        self._set_priors()
        self.solution: RobustSolution | None = None

    @property
    def x(self) -> NDArray:
        """All variables where the adjustment stands."""
        return self.program.start

    @property
    def cameras(self) -> tuple[Camera, ...]:
        """The cameras where the adjustment stands.

        Raises:
            NotConvergedError: If they have become cameras that cannot be.
        """
        try:
            return self.block.cameras(self.x)
        except ValueError as error:
            raise NotConvergedError(f"no plausible camera fits the corners: {error}") from error

    @property
    def X_LG(self) -> NDArray:
        """Poses of the boards where the adjustment stands. Shape (V, 4, 4)."""
        return self.block.board_poses(self.x)

    @property
    def rms(self) -> float:
        """Median over the views of their root mean square error [px]."""
        return float(np.median(self._view_rms(self.x)))

    def approach(self, tolerance: float) -> None:
        """Go near the minimum, close enough for a start."""
        self.program.move_start(self.program.solve(tolerance=tolerance, max_iterations=30).x)

    def approach_without_outliers(self) -> None:
        """Go near the minimum of the boards that agree, where some stand out."""
        if self._suspicious(self.x):
            solve_robustly(self.program, self.number, "cauchy", rough=True)
            self.program.set_loss(self.number, Loss())

    def solve(self, loss: str, outliers: NDArray | None = None) -> None:
        """Least squares; where a board stands out and the loss allows, once more without it.

        What priors weigh against the corners depends on how sharp these are, which the start tells,
        or the solution where the start was too far off.

        Args:
            loss: One of `optimization.robust_solve.ROBUST_METHODS`.
            outliers: Views that are known to be, where they are not to be looked for. Shape (V,).
        """
        self._set_priors()
        if self.program.priors:
            self.block.sigma = self._sharpness(self.x, np.ones(len(self.views), dtype=bool))
        for _ in range(_ROUNDS):
            self.solution = self._solved(loss, outliers)
            if not self.program.priors:
                return
            before, outliers = self.block.sigma, self.solution.outliers
            sigma = self._sharpness(self.solution.solution.x, ~outliers)
            if abs(sigma - before) <= _SHARP * sigma:
                return
            self.block.sigma = sigma

    def _set_priors(self) -> None:
        """Set the priors that were stated, and those of rational lenses as wide as they are."""
        priors = _rational_priors(self.views, self.cameras) | self.stated
        for name, (mean, sigma) in priors.items():
            if name not in self.held:
                self.program.add_prior(name, mean, sigma)

    def _solved(self, loss: str, outliers: NDArray | None) -> RobustSolution:
        """Return one solution with corners as sharp as they are thought to be."""
        if outliers is not None:
            return solve_without(self.program, self.number, outliers)
        start = self.x
        found = solve_robustly(self.program, self.number, "none")
        if loss != "none" and (loss != "trimmed" or self._suspicious(found.solution.x)):
            limit = OUTLIER_RATIO * np.sqrt(3.0)
            # A board that is quite wrong has pulled the least squares solution its way.
            self.program.move_start(start)
            found = solve_robustly(self.program, self.number, loss, outlier_at=limit)
        return found

    def result(self, seconds: float) -> CameraCalibration:
        """Return what was found."""
        assert self.solution is not None
        found, outliers = self.solution.solution, self.solution.outliers
        parts = self.block.evaluate_parts(found.x)
        uncertainty = self._uncertainty(parts, ~outliers)
        sigma = self.block.sigma
        return CameraCalibration(
            self.views,
            self.cameras,
            self.block.board_poses(found.x),
            self.block.pixel_residuals(parts[0]),
            outliers,
            uncertainty.names,
            uncertainty,
            sigma * float(np.sqrt(uncertainty.variance_factor)),
            0.5 * sigma**2 * float(np.sum(parts[0][~outliers] ** 2)),
            found.converged,
            self.solution.iterations,
            seconds,
            sigma**2 * self._squares_alone(parts),
        )

    def _squares_alone(self, parts: Parts) -> NDArray:
        """Return squares of each view in each camera, and with a pose of its own. (V, C, 2).

        r - A (A'A)^-1 A'r to first order, A by the board's pose: Fisher's analysis of variance.
        """
        views, cameras = len(self.views), len(self.views.cameras)
        r = parts[0].reshape(views, cameras, -1)
        A = parts[2].reshape(views, 6, cameras, -1).transpose(0, 2, 1, 3)
        together = np.sum(r * r, axis=2)
        H, g = A @ np.swapaxes(A, 2, 3), (A @ r[:, :, :, None])[:, :, :, 0]
        diagonal = np.einsum("vcii->vci", H)
        told = self.views.seen.sum(axis=2) >= FEWEST_ALONE
        # A wrong lens may put a board where a turn and a shift of it look the same.
        H = H + np.eye(6) * (_ALMOST_NONE * diagonal + (diagonal == 0.0))[:, :, None, :]
        alone = together - np.sum(g * np.linalg.solve(H, g[:, :, :, None])[:, :, :, 0], axis=2)
        return np.where(told[:, :, None], np.stack([together, alone], axis=2), np.nan)

    def _suspicious(self, x: NDArray) -> bool:
        rms = self._view_rms(x)
        return bool((rms > SUSPICIOUS * np.median(rms)).any())

    def _view_rms(self, x: NDArray) -> NDArray:
        r = self.block.sigma * self.block.residuals(x)
        return np.sqrt(np.sum(r * r, axis=0) / self.views.seen.sum(axis=(1, 2)))

    def _sharpness(self, x: NDArray, inliers: NDArray) -> float:
        """Return the standard deviation of a pixel coordinate of some views [px]."""
        r = self.block.sigma * self.program.residuals(self.number, x)[:, inliers]
        return max(float(np.sqrt(np.sum(r * r) / self._redundancy(inliers))), _EXACT)

    def _redundancy(self, inliers: NDArray) -> int:
        """Return the number of coordinates less that of the boards' variables."""
        return 2 * int(self.views.seen[inliers].sum()) - 6 * int(inliers.sum())

    def _uncertainty(self, parts: Parts, inliers: NDArray) -> Uncertainty:
        """Return the covariance of the free camera parameters, boards eliminated.

        Where there are enough of them, residuals tell how sharp corners are, and where.
        """
        names = self.block.shared_names
        columns = np.flatnonzero(self.program.free[: len(names)])
        free = tuple(names[i] for i in columns)
        jacobian = self.block.reduced_jacobian(parts, inliers.astype(float))[:, columns]
        priors = [
            (np.array(free) == name) / sigma
            for name, (_, sigma) in self.program.priors.items()
            if name in free
        ]
        scatter = None
        if self._tells_scatter(inliers):
            told = corner_noise(self.views, parts, jacobian, inliers)
            scatter = [np.append(one, np.ones(len(priors))) for one in told]
        return Uncertainty.from_jacobian(
            free,
            np.vstack([jacobian, *priors]) if priors else jacobian,
            natural_scales(free, self.views, self.x[: len(names)], names),
            float(np.sum(parts[0][inliers] ** 2)),
            self._redundancy(inliers) + len(priors),
            scatter,
        )

    def _tells_scatter(self, inliers: NDArray) -> bool:
        """Whether there are enough residuals to say how each of them scatters."""
        free = int(self.program.free[: len(self.block.shared_names)].sum())
        return self._redundancy(inliers) >= _PER_PARAMETER * free


def _rational_priors(
    views: BoardViews, cameras: tuple[Camera, ...]
) -> dict[str, tuple[float, float]]:
    """Return what is known beforehand of k4, k5, k6: that they are of the size of what they bend.

    Numerator and denominator of a rational lens do nearly the same: no boards tell all six.
    """
    return {
        f"{side}.k{4 + i}": (0.0, _RATIONAL * (_reach(camera)) ** (-2 * i - 2))
        for side, camera in zip(views.cameras, cameras, strict=True)
        if camera.lens == RATIONAL
        for i in range(3)
    }


def _reach(camera: Camera) -> float:
    """Return the radius of the image's corner over the focal length."""
    return 0.5 * float(np.hypot(*camera.image_size)) / camera.fx


def natural_scales(
    free: tuple[str, ...], views: BoardViews, values: NDArray, names: tuple[str, ...]
) -> NDArray:
    """Return the scale of each parameter on which its sigma says whether it is known at all.

    Focal lengths by themselves, four times the way to the image's corner at most; the principal
    point by half the image; k_i by what bends the corner by its radius; 1 rad; the board's size.
    """
    board = float(np.linalg.norm(np.ptp(views.p_GQ, axis=0)))
    scales = []
    for name in free:
        camera, _, what = name.partition(".")
        half = 0.5 * np.array(views.size_of(camera))
        # Above and below the fraction of a rational lens k_i stand for each other.
        loose = _LOOSE if f"{camera}.k6" in names and what[0] == "k" else 1.0
        focal = values[names.index(f"{camera}.fx")]
        corner = float(np.hypot(*half))
        radius, focal = corner / focal, min(focal, 4.0 * corner)  # one that ran away tells none
        by_angle = f"{camera}.k4" in names and f"{camera}.k6" not in names  # a fisheye
        scales.append(
            loose
            * {
                "fx": focal,
                "fy": focal,
                "skew": focal,
                "cx": half[0],
                "cy": half[1],
                "k1": radius**-2,
                "k2": radius**-4,
                "k3": radius**-6,
                "k4": radius ** (-8 if by_angle else -2),
                "k5": radius**-4,
                "k6": radius**-6,
                "p1": 1.0 / radius,
                "p2": 1.0 / radius,
            }.get(what, 1.0 if what[-2:] in ("rx", "ry", "rz") else board)
        )
    return np.array(scales)
