"""How well arm and cameras are known together, and what the mechanics leave."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.dataset.board_views import BoardViews
from nico_selfmodel.estimation.body.body_problem import BodySolution
from nico_selfmodel.estimation.cameras.board_residuals import BoardResiduals
from nico_selfmodel.estimation.cameras.camera_adjustment import natural_scales
from nico_selfmodel.estimation.noise.arm_solution import Priors
from nico_selfmodel.estimation.noise.hand_noise import HandNoise
from nico_selfmodel.estimation.observations.arm_views import DhArm
from nico_selfmodel.estimation.observations.hand_pixels import HandPixels
from nico_selfmodel.estimation.observations.pixel_observations import PixelObservations
from nico_selfmodel.model.arm.dh_parameters import DhParameters
from nico_selfmodel.model.cameras.rig_parameters import SIDES
from nico_selfmodel.model.cameras.stereo_rig import StereoRig
from nico_selfmodel.optimization.uncertainty import Uncertainty, scales_by_priors


@dataclass(frozen=True, eq=False)
class WhitenedRows:
    """What hand and boards say of the free parameters at a solution."""

    names: tuple[str, ...]
    """Free parameters. Length k."""
    jacobian: NDArray
    """Derivatives of the whitened residuals, the boards' poses eliminated. Shape (m, k)."""
    scales: NDArray
    """Natural scale of each parameter. Shape (k,)."""
    squares: float
    """Sum of squared whitened residuals."""
    count: int
    """How many residuals carry weight."""


def body_uncertainty(
    observations: PixelObservations,
    parameters: DhParameters,
    solved: BodySolution,
    free: frozenset[str],
    boards: BoardViews | None,
    whitened: bool,
    priors: Priors | None = None,
) -> Uncertainty:
    """Analyse the inlier rows and the boards at a solution.

    Args:
        observations: What was seen.
        parameters: The arm.
        solved: Cameras, variances and outliers.
        free: Parameters that were estimated.
        boards: Corners in the same problem, if any.
        whitened: Whether the variances are known; else one for all pixels is estimated.
        priors: Of numbers that bend.

    Returns:
        Covariance in the names of arm and cameras, the boards' poses eliminated.
    """
    rows = whitened_rows(observations, parameters, solved, free, boards, whitened)
    now = dict(zip(parameters.names, parameters.values.tolist(), strict=True))
    prior, pulls = np.zeros((len(priors or {}), len(rows.names))), []
    for i, (name, (mean, sigma)) in enumerate((priors or {}).items()):
        prior[i, rows.names.index(name)] = 1.0 / sigma
        pulls.append((now[name] - mean) / sigma)
    # A prior is an equation like any other: what it alone tells has taken nothing from the rest.
    squares, count = rows.squares + float(np.sum(np.square(pulls))), rows.count + len(pulls)
    jacobian = np.vstack([rows.jacobian, prior])
    scales = scales_by_priors(rows.names, rows.scales, priors or {})
    return Uncertainty.from_jacobian(rows.names, jacobian, scales, squares, count)


def whitened_rows(
    observations: PixelObservations,
    parameters: DhParameters,
    solved: BodySolution,
    free: frozenset[str],
    boards: BoardViews | None,
    whitened: bool,
    size: float | None = None,
) -> WhitenedRows:
    """Return what `body_uncertainty` analyses; the arguments are its own.

    `size` is what lengths are held against, that of the poses' workspace if omitted [m].
    """
    inliers = observations.select(~solved.outliers)
    block = HandPixels(inliers, DhArm(inliers.arm, parameters), lens=solved.rig.lens)
    x = np.concatenate([parameters.values, solved.rig.values])
    if whitened:
        block.whiten(solved.noise.whitening(block.by_angle(x), inliers.seen))
    r, jacobian = block.evaluate(x)
    names = tuple(name for name in block.names if name in free)
    columns = [block.names.index(name) for name in names]
    rows = [jacobian[columns].reshape(len(columns), -1).T]
    squares, count = float(np.sum(r * r)), int(inliers.seen.sum())
    if boards is not None:
        part, rest, extra = board_rows(boards, solved, names)
        rows.append(part)
        squares, count = squares + float(np.sum(rest**2)), count + extra
    scales = _natural(names, parameters, solved.rig, size or _size(x, block))
    return WhitenedRows(names, np.vstack(rows), scales, squares, count)


def noise_sigmas(
    observations: PixelObservations, parameters: DhParameters, solved: BodySolution
) -> tuple[float, float]:
    """Return how surely the inlier rows tell tracker noise [px] and joint noise [rad]."""
    inliers = observations.select(~solved.outliers)
    block = HandPixels(inliers, DhArm(inliers.arm, parameters), lens=solved.rig.lens)
    slopes = block.by_angle(np.concatenate([parameters.values, solved.rig.values]))
    return solved.noise.sigmas(slopes, inliers.seen)


def position_sigma(
    observations: PixelObservations, parameters: DhParameters, noise: HandNoise
) -> float:
    """Return what the play of the joints does to a coordinate of the hand, rms [m].

    Args:
        observations: Poses to take the mean over.
        parameters: The arm.
        noise: Its joint sigma.
    """
    view = DhArm(observations.arm, parameters)
    slopes = view.by_angle(parameters.values)
    return noise.joint_sigma * float(np.sqrt(np.mean(np.sum(slopes**2, axis=(0, 1))) / 3.0))


def board_rows(
    boards: BoardViews, solved: BodySolution, names: tuple[str, ...]
) -> tuple[NDArray, NDArray, int]:
    """Return what the boards say of some parameters, their own poses free.

    Args:
        boards: Their corners.
        solved: Cameras and poses of the boards.
        names: Of the columns, k of them.

    Returns:
        Derivatives of the whitened residuals, shape (B, k), these, shape (B,), and how many
        coordinates more than poses there are.
    """
    assert solved.corner_sigma is not None
    assert solved.X_LG is not None
    X_LG = solved.X_LG
    block = BoardResiduals(boards, X_LG, solved.corner_sigma, lens=solved.rig.lens)
    parts = block.evaluate_parts(block.start_of(solved.rig.cameras, X_LG))
    reduced = block.reduced_jacobian(parts, np.ones(len(boards)))
    out = np.zeros((len(reduced), len(names)))
    for column, name in enumerate(block.shared_names):
        if name in names:
            out[:, names.index(name)] = reduced[:, column]
    return out, parts[0].ravel(), 2 * int(boards.seen.sum()) - 6 * len(boards)


def _size(x: NDArray, block: HandPixels) -> float:
    """Return the size of the workspace: rms distance of the hand from its mean [m]."""
    p = block.arm.evaluate(x[: len(block.arm.names)])[0]
    return float(np.sqrt(np.sum(np.var(p, axis=1))))


def _natural(
    names: tuple[str, ...], parameters: DhParameters, rig: StereoRig, size: float
) -> NDArray:
    """Return the scale of each parameter on which its sigma says whether it is known at all."""
    scale = dict(zip(parameters.names, parameters.scales(size).tolist(), strict=True))
    # A board as large as the workspace, for the scales of the cameras.
    corners = size * np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0]])
    views = BoardViews(corners, (), SIDES, np.zeros((0, 2, 4)), rig.left.image_size)
    cameras = tuple(name for name in names if name not in scale)
    scale |= dict(
        zip(cameras, natural_scales(cameras, views, rig.values, rig.names).tolist(), strict=True)
    )
    return np.array([scale[name] for name in names])
