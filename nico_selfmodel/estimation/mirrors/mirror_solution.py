"""One least squares problem: the planes of all mirrors on the pixels of both cameras."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.errors import DataError, NotConvergedError
from nico_selfmodel.estimation.mirrors.mirror_initialization import start_plane
from nico_selfmodel.estimation.mirrors.reflection_residuals import (
    ReflectionResiduals,
    independent_covariance,
    project_reflections,
    shared_factor,
    whitening_of,
)
from nico_selfmodel.estimation.mirrors.reflections import ReflectionNoise, Reflections
from nico_selfmodel.geometry.reflection import reflect
from nico_selfmodel.geometry.transform import apply
from nico_selfmodel.model.cameras.mirror import Mirror
from nico_selfmodel.optimization.calibration_program import CalibrationProgram
from nico_selfmodel.optimization.losses import Loss, robust_scale
from nico_selfmodel.optimization.robust_solve import RobustSolution, solve_robustly
from nico_selfmodel.optimization.uncertainty import Uncertainty

_FEWEST_ROBUST = 5
"""Rows of a mirror from which on one that contradicts the others can be told."""
_ROUGH = 1e-4
"""Tolerance of the solution about which the rows are whitened."""
_ASSUMED = 4
"""The stated noise counts as this many redundant pixels when its scale is estimated."""


@dataclass(frozen=True, eq=False)
class MirrorSolution:
    """Planes that fit reflections best."""

    reflections: Reflections
    """What was given."""
    mirrors: tuple[Mirror, ...]
    """The planes with their covariance, in the order of `reflections.mirrors`."""
    noise: ReflectionNoise
    """What whitened the pixels."""
    residuals: NDArray
    """Measured minus predicted pixels, nan where not seen [px]. Shape (N, 2 C)."""
    outliers: NDArray
    """Rows that were outliers. Boolean, shape (N,)."""
    uncertainty: Uncertainty
    """Of all planes together."""
    converged: bool
    """Whether the solver reached a minimum."""
    iterations: int
    """Of the last adjustment."""
    shared: NDArray | None = None
    """Covariance of all planes' values with what arm and cameras are wrong by, the parameters of
    `reflections.shared`; None where nothing is known of these. Shape (3 M, K)."""

    @property
    def distances(self) -> NDArray:
        """Reprojection error of each row in each camera, nan where not seen [px]. Shape (N, C)."""
        return np.linalg.norm(self.residuals.reshape(len(self.residuals), -1, 2), axis=2)

    @property
    def in_front_by(self) -> NDArray:
        """How far each row's point is in front of its glass [m]. Shape (N,)."""
        planes = [mirror.in_front_by(self.reflections.p_LQ) for mirror in self.mirrors]
        return np.choose(self.reflections.mirror, planes)


def start_mirrors(reflections: Reflections) -> tuple[Mirror, ...]:
    """Place every mirror in closed form.

    Returns:
        Planes without covariance, in the order of `reflections.mirrors`.

    Raises:
        DataError: If a mirror would stand between the cameras and the points.
        NotIdentifiableError: If the reflections leave a plane open.
    """
    found = []
    for name in reflections.mirrors:
        plane = start_plane(reflections.of(name))
        if plane.offset <= 0.0:
            raise DataError(
                f"the hand lies behind mirror {name!r}: the plane between it and what was seen "
                f"stands {-1e3 * plane.offset:.0f} mm from the left camera, with camera and hand "
                "on opposite sides; are these pixels of another point, or of another pose?"
            )
        found.append(Mirror.from_plane(plane))
    return tuple(found)


def solve_mirrors(
    reflections: Reflections,
    start: tuple[Mirror, ...],
    noise: ReflectionNoise,
    loss: str = "trimmed",
) -> MirrorSolution:
    """Fit three parameters a mirror to the pixels of all cameras.

    Args:
        start: Planes near the solution.
        noise: Of pixels and joints; with the arm's own covariance it whitens each row.
        loss: One of `optimization.robust_solve.ROBUST_METHODS`, per row; plain least squares where
            a mirror has too few rows to tell which is wrong.

    Raises:
        NotConvergedError: If a plane behind the left camera comes out.
    """
    x = np.concatenate([mirror.values for mirror in start])
    block = ReflectionResiduals(reflections, whitening_of(reflections, x, noise))
    program = CalibrationProgram()
    program.add_variables(block.names, x)
    number = program.add_residuals(block)
    fewest = int(np.bincount(reflections.mirror, minlength=len(start)).min())
    method = loss if fewest >= _FEWEST_ROBUST else "none"
    if method != "none":
        norms = np.linalg.norm(program.residuals(number, x), axis=0)
        scale = robust_scale(norms, reflections.pixels.shape[1])
        program.set_loss(number, Loss("cauchy", scale))
    program.move_start(program.solve(tolerance=_ROUGH, max_iterations=30).x)
    # The whitening moves with the planes, though little: laid anew near the solution.
    block.whiten(whitening_of(reflections, program.start, noise))
    found = solve_robustly(program, number, method)
    return _solution(reflections, block, found, noise)


def _solution(
    reflections: Reflections,
    block: ReflectionResiduals,
    found: RobustSolution,
    noise: ReflectionNoise,
) -> MirrorSolution:
    """Gather what is known at the solution."""
    x = found.solution.x
    uncertainty, shared = _uncertainty(reflections, block, x, ~found.outliers, noise)
    mirrors = []
    for m, name in enumerate(reflections.mirrors):
        own = slice(3 * m, 3 * m + 3)
        try:
            mirrors.append(Mirror.from_values(x[own], uncertainty.covariance[own, own]))
        except ValueError as error:
            raise NotConvergedError(
                f"no mirror fits the reflections in {name!r}: the plane that fits them best stands "
                "behind the left camera; are these pixels reflections of this hand?"
            ) from error
    _require_sight(reflections, mirrors, ~found.outliers)
    shown = project_reflections(reflections, x).pixels
    return MirrorSolution(
        reflections,
        tuple(mirrors),
        noise,
        reflections.pixels - shown,
        found.outliers,
        uncertainty,
        found.solution.converged,
        found.iterations,
        shared,
    )


def _require_sight(reflections: Reflections, mirrors: list[Mirror], inliers: NDArray) -> None:
    """Refuse planes whose reflections a camera would have to see behind itself.

    Raises:
        NotConvergedError: Naming the mirror.
    """
    X_WL = reflections.cameras[0].X_WC
    for m, name in enumerate(reflections.mirrors):
        rows = inliers & (reflections.mirror == m)
        virtual = reflect(mirrors[m].plane_in(X_WL), reflections.p_WQ[rows])
        depths = [apply(camera.X_CW, virtual)[:, 2] for camera in reflections.cameras]
        behind = np.asarray(np.min(depths, axis=0) <= 0.0)
        if behind.any():
            raise NotConvergedError(
                f"no mirror fits the reflections in {name!r}: in the plane that fits them best "
                f"{int(behind.sum())} of {len(behind)} would appear behind the cameras; are left "
                "and right exchanged, or are these pixels of another thing?"
            )


def _uncertainty(
    reflections: Reflections,
    block: ReflectionResiduals,
    x: NDArray,
    inliers: NDArray,
    noise: ReflectionNoise,
) -> tuple[Uncertainty, NDArray | None]:
    """Return the covariance of the planes: noise averages out over poses, the arm's errors do not.

    With x = K r, K = C_0 J', C_0 = (J'J)^-1: s^2 C_0 + K (s^2 (N - 1) + F F') K', N what is each
    row's own and F what is shared by all rows, F = D C^1/2 with C the covariance of arm and
    cameras. The planes follow their errors by - K D, so that - K F C^1/2' is their covariance with
    these. What of a plane nothing tells follows nothing, and C_0 has it.
    """
    r, jacobian = block.evaluate(x)
    rows = np.transpose(jacobian, (2, 1, 0))[inliers]
    stacked = rows.reshape(-1, len(x))
    counted = int(reflections.seen[inliers].sum()) + _ASSUMED
    squares = float(np.sum(r[:, inliers] ** 2)) + _ASSUMED
    heights = [max(float(values[2]), 1e-3) for values in x.reshape(-1, 3)]
    natural = np.array([part for height in heights for part in (1.0, 1.0, height)])
    plain = Uncertainty.from_jacobian(block.names, stacked, natural, squares, counted)
    if reflections.shared is None:
        return plain, None
    gain = plain.covariance / plain.variance_factor @ stacked.T
    gain = gain.reshape(len(x), *rows.shape[:2])
    white, by_point = block.whitening, project_reflections(reflections, x).by_point
    own = white @ independent_covariance(reflections, by_point, noise) @ np.swapaxes(white, 1, 2)
    factor = shared_factor(reflections, x, by_point)
    assert factor is not None
    systematic = np.einsum("xnk,nkj->xj", gain, (white @ factor)[inliers])
    own = own[inliers] - np.eye(rows.shape[1])
    covariance = np.einsum("xnk,nkl,ynl->xy", gain, own, gain) * plain.variance_factor
    covariance = plain.covariance + covariance + systematic @ systematic.T
    sigma = np.where(np.isfinite(plain.sigma), np.sqrt(np.diag(covariance)), np.inf)
    found = replace(plain, covariance=covariance, sigma=sigma)
    return found, -systematic @ reflections.shared.root.T
