"""How well arm and cameras are known together, what few poses leave open, and mechanics leave."""

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.estimation.body.arm_parameters import ArmParameters
from nico_selfmodel.estimation.noise.hand_noise import HandNoise
from nico_selfmodel.estimation.observations.hand_rows import HandPixels
from nico_selfmodel.estimation.observations.pixel_observations import PixelObservations
from nico_selfmodel.estimation.tree.bending_tree import TreeBend
from nico_selfmodel.estimation.tree.tree_problem import TreeProblem
from nico_selfmodel.model.arm.dh_parameters import DhParameters, slopes_by_angle
from nico_selfmodel.model.cameras.stereo_rig import StereoRig
from nico_selfmodel.optimization.uncertainty import Uncertainty, scales_by_priors


def body_uncertainty(found: TreeBend, observations: PixelObservations) -> Uncertainty:
    """Analyse what counts at a solution.

    Returns:
        Covariance in the names of arm and cameras, the boards' poses eliminated.
    """
    parameters, solution = found.problem.residuals.parameters, found.solution
    assert isinstance(parameters, ArmParameters)
    arm = parameters.arm_of(solution.values)
    p = observations.arm.predicted(arm)[0]
    size = float(np.sqrt(np.sum(np.var(p, axis=0))))
    bends = set(parameters.names[parameters.bends])
    held = {name: prior for name, prior in found.problem.priors.items() if name in bends}
    scales = scales_by_priors(found.problem.free_names, _natural_of(found.problem, size), held)
    count = len(solution.whitened)
    squares = float(count - len(scales))
    if not solution.variances_known:
        squares = float(solution.rest @ solution.rest)
    rows = solution.whitened
    return Uncertainty.from_jacobian(found.problem.free_names, rows, scales, squares, count)


def _natural_of(problem: TreeProblem, size: float) -> NDArray:
    """Return the natural scale of what is free.

    Args:
        problem: By name.
        size: What lengths are held against [m].

    Returns:
        Shape (k,).
    """
    parameters = problem.residuals.parameters
    assert isinstance(parameters, ArmParameters)
    return parameters.scales(size)[problem.columns]


def open_at(problem: TreeProblem, size: float) -> tuple[str, ...]:
    """Return which free parameters cannot be observed, wholly or in part, at a body that is known.

    Args:
        problem: Arm and cameras by name, where they begin.
        size: What lengths are held against [m].

    Returns:
        Names, those that the data tell least of first; empty where the data tell all.
    """
    rows = problem.whitened_start()
    # The variances are given: nothing is scaled by how the start misses what was seen.
    natural = _natural_of(problem, size)
    found = Uncertainty.from_jacobian(problem.free_names, rows, natural, 0.0, 0)
    share = dict.fromkeys(found.names, 0.0)
    for direction in found.unobservable:
        for name, part in zip(direction.names, direction.shares.tolist(), strict=True):
            share[name] += part**2
    unknown = np.array(found.names)[~np.isfinite(found.sigma)].tolist()
    return tuple(sorted(unknown, key=lambda name: -share[name]))


def noise_sigmas(
    inliers: PixelObservations, parameters: DhParameters, rig: StereoRig, noise: HandNoise
) -> tuple[float, float]:
    """Return how surely the inlier rows tell tracker noise [px] and joint noise [rad]."""
    block = HandPixels(inliers, parameters, rig.lenses)
    slopes = block.by_angle(np.concatenate([parameters.values, rig.values]))
    return noise.sigmas(slopes, inliers.seen)


def position_sigma(
    observations: PixelObservations, parameters: DhParameters, noise: HandNoise
) -> float:
    """Return what the play of the joints does to a coordinate of the hand, rms [m].

    Args:
        observations: Poses to take the mean over.
        noise: Its joint sigma.
    """
    slopes = slopes_by_angle(parameters, observations.arm.predicted(parameters)[1])
    return noise.joint_sigma * float(np.sqrt(np.mean(np.sum(slopes**2, axis=(1, 2))) / 3.0))
