"""The noise of a recording by name, and at first, before an adjustment tells it."""

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.dataset.body.sensors import TOUCHES
from nico_selfmodel.estimation.tree.noise.finer_noise import coarser_noise
from nico_selfmodel.estimation.tree.tree_observations import SensorRows, TreeObservations
from nico_selfmodel.estimation.tree.tree_solution import TreeNoise
from nico_selfmodel.model.tree.body_tree import FLANGE, FREE
from nico_selfmodel.optimization.losses import Loss, robust_scale

_FAR = 8.0
"""Robust standard deviations of three coordinates beyond which nothing counts at first."""


def robust_weights(data: TreeObservations, r: NDArray) -> tuple[NDArray, float]:
    """Return Cauchy's weights, by the median of each sensor, and a cost by which starts compare.

    Args:
        r: What a start leaves, in the sensors' standard deviations. Shape (R,).

    Returns:
        Of each scalar, shape (R,), and the sum of k log(scale) and rho.
    """
    squared = data.per_row(r * r)
    weight, cost = np.ones(len(squared)), 0.0
    for rows in data.sensors:
        k = rows.measured.shape[1]
        own = squared[rows.rows]
        scale = _scale_at_first(data, rows, np.sqrt(own))
        rho, w = Loss("cauchy", max(scale, 1e-9)).rho_and_weight(own, k)
        weight[rows.rows] = w / scale**2
        cost += float(rho.sum()) / scale**2 + 2.0 * k * len(own) * np.log(scale)
    return weight[data.row], cost


def standing_out(data: TreeObservations, r: NDArray, told: int) -> NDArray:
    """Return observations that are far out at a start, by the median of their sensor.

    Args:
        r: What the start leaves, in the sensors' standard deviations. Shape (R,).
        told: How many numbers any body fits: that the rest fits contradicts nothing if it has no
            more.

    Returns:
        Boolean, by row of the table. Shape (N,).
    """
    norms = np.sqrt(data.per_row(r * r))
    out = np.zeros(len(norms), dtype=bool)
    for rows in data.sensors:
        k, own = rows.measured.shape[1], norms[rows.rows]
        if not data.sigma_held[data.noise_group[rows.first]]:
            out[rows.rows] = own > _FAR * np.sqrt(k / 3.0) * _scale_at_first(data, rows, own)
    return out & ((~out[data.row]).sum() > told)


def _scale_at_first(data: TreeObservations, rows: SensorRows, norms: NDArray) -> float:
    """Return how large the residuals of a sensor are at a start, in its standard deviation.

    Touches are few for what they tell: a start may explain most of them to the last digit, and
    nothing of the rest.
    """
    if data.sigma_held[data.noise_group[rows.first]]:
        return 1.0
    scale = robust_scale(norms, rows.measured.shape[1])
    return max(scale, 1.0) if rows.kind in TOUCHES else scale


def names_of_noise(noise: TreeNoise, seen: TreeObservations) -> dict[str, float]:
    """Return the standard deviations of sensors and joints, by name [m, rad or px]."""
    out = dict(zip(seen.noise_groups, noise.sensor.tolist(), strict=True))
    out = {name: sigma for name, sigma in out.items() if _is_told(name, out)}
    for (i, part), sigma in zip(seen.noisy_joints, noise.joint.tolist(), strict=True):
        joint = seen.data.joints[i]
        suffix = "" if joint.motion != FLANGE else (" turn" if part < 3 else " place")
        out |= {} if joint.motion == FREE else {f"{joint.name}{suffix}": sigma}
    return out


def _is_told(name: str, sigmas: Mapping[str, float]) -> bool:
    """Whether a noise group has a standard deviation of its own, or is no finer one."""
    coarser = coarser_noise(name)
    return coarser == name or sigmas[name] != sigmas.get(coarser)


def sensor_noise_named(names: Mapping[str, float], seen: TreeObservations) -> NDArray:
    """Return the standard deviations of noise groups that are known by name; nan if not. (G,)."""
    groups = seen.noise_groups
    return np.array([names.get(g, names.get(coarser_noise(g), np.nan)) for g in groups])


def noise_named(names: Mapping[str, float], seen: TreeObservations) -> TreeNoise | None:
    """Return noise that is known by name; None where not all that is needed is known.

    Args:
        names: Standard deviations, as `BodyModel.noise` has them.
        seen: What it is needed for.
    """
    joints = [seen.data.joints[i].name for i, _ in seen.noisy_joints]
    parts = ["" if name in names else " turn" if part < 3 else " place"
             for name, (_, part) in zip(joints, seen.noisy_joints, strict=True)]  # fmt: skip
    noisy = [f"{name}{part}" for name, part in zip(joints, parts, strict=True)]
    sensor = sensor_noise_named(names, seen)
    if not set(noisy) <= set(names) or np.isnan(sensor).any():
        return None
    return TreeNoise(sensor, np.array([names[n] for n in noisy]))
