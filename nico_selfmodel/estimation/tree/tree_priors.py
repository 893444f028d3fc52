"""What is known of a body beforehand, and how far a described robot is off, as the data tell it.

Parts of the described frames are off by N(0, v), v alike for all turns and for all places. With
H = J' S^-1 J, C = (H + V^-1)^-1 and x what a part is off by, the restricted likelihood of log v has

    score        (|x|^2 / v - (n - tr C / v)) / 2             of the n parts that share v
    information  |1 - V^-1/2 C V^-1/2|_gh^2 / 2               of two groups g, h

(MacKay 1992; Gilmour, Thompson, Cullis 1995). Beforehand log v is about what a description is said
to be off by, within a factor of three of the standard deviation: where few parts are told it stays.
"""

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.dataset.body.sensors import CONTACT, PLANE
from nico_selfmodel.estimation.tree.tree_observations import TreeObservations
from nico_selfmodel.estimation.tree.tree_setup import Alike, Priors
from nico_selfmodel.optimization.uncertainty import covariance_told_by

BEFOREHAND = 0.5 / np.log(3.0)
"""Root of the information that the logarithm of a variance has without data."""
_ALIKE = 0.02
"""Relative change of a standard deviation below which it is the same."""
_ROUNDS, _SETTLED, _LARGEST_STEP = 30, 1e-3, 1.0


def beside_noise(
    priors: Priors, seen: TreeObservations, bends: Sequence[str], *, few: bool
) -> Priors:
    """Return those priors that count where residuals are asked for their noise.

    A robot's description says nothing there: where it is wrong, a noise that made up for that would
    make it weigh more still. What bends has priors that follow the data. But few data would be
    explained to the last digit without a description, and touches by a body of no size.

    Args:
        priors: All of them.
        seen: What was measured.
        bends: Names of what bends.
        few: Whether there are hardly more numbers than parameters.
    """
    if few or all(rows.kind in (CONTACT, PLANE) for rows in seen.sensors):
        return priors
    return {name: prior for name, prior in priors.items() if name in bends}


def prior_rows(
    priors: Priors, names: Sequence[str], values: Mapping[str, float]
) -> tuple[NDArray, NDArray]:
    """Return priors as whitened rows: derivatives by what is free, and residuals.

    Args:
        priors: Mean and standard deviation, by name.
        names: What is free.
        values: By name.

    Returns:
        Shapes (priors, k) and (priors,).
    """
    place = {name: i for i, name in enumerate(names)}
    told = [name for name in names if name in priors]
    rows, rest = np.zeros((len(told), len(names))), np.zeros(len(told))
    for i, name in enumerate(told):
        mean, sigma = priors[name]
        rows[i, place[name]], rest[i] = 1.0 / sigma, (values[name] - mean) / sigma
    return rows, rest


def information_of(priors: Priors, names: Sequence[str]) -> NDArray:
    """Return the inverse variances of what is free, 0 where nothing is known of it. Shape (k,)."""
    return np.array([priors[name][1] ** -2.0 if name in priors else 0.0 for name in names])


def pull_of(priors: Priors, names: Sequence[str], values: Mapping[str, float]) -> NDArray:
    """Return how far means are from what is free, 0 where nothing is known of it. Shape (k,)."""
    return np.array([priors[n][0] - values[n] if n in priors else 0.0 for n in names])


def are_alike(one: Priors, other: Priors) -> bool:
    """Whether no standard deviation changed."""
    return all(abs(np.log(one[name][1] / other[name][1])) < _ALIKE for name in one)


def likeliest_priors(
    priors: Priors,
    alike: Sequence[Alike],
    names: Sequence[str],
    values: Mapping[str, float],
    white: tuple[NDArray, NDArray],
) -> Priors:
    """Return priors whose standard deviations the data ask for, those of a group alike.

    Args:
        priors: As they are.
        alike: Groups that share one.
        names: What is free.
        values: Where `white` is.
        white: Whitened derivatives by what is free, and residuals; priors are not among them.

    Returns:
        All priors.
    """
    groups = [(own, one.sigma) for one in alike if len(own := _places(one, names))]
    if not groups:
        return priors
    members, sigmas = [own for own, _ in groups], np.array([sigma for _, sigma in groups])
    U, u = white
    mean = np.array([priors[name][0] if name in priors else 0.0 for name in names])
    off = np.array([values[name] for name in names]) - mean
    others = information_of(priors, names)
    others[np.concatenate(members)] = 0.0
    H, g = U.T @ U + np.diag(others), U.T @ u + others * off
    x = 2.0 * np.log([priors[names[int(own[0])]][1] for own in members])
    for _ in range(_ROUNDS):
        step = _step(x, 2.0 * np.log(sigmas), members, H, g, off)
        x = x + np.clip(step, -_LARGEST_STEP, _LARGEST_STEP)
        if np.abs(step).max() < _SETTLED:
            break
    found = np.exp(0.5 * x).tolist()
    learned = {names[i]: sigma for own, sigma in zip(members, found, strict=True) for i in own}
    return {n: (m, learned.get(n, sigma)) for n, (m, sigma) in priors.items()}


def _places(alike: Alike, names: Sequence[str]) -> NDArray:
    """Return which of the names are in a group."""
    return np.flatnonzero(np.isin(names, alike.names))


def _step(
    x: NDArray, begin: NDArray, groups: Sequence[NDArray], H: NDArray, g: NDArray, off: NDArray
) -> NDArray:
    """Return a scoring step of the logarithms of the variances."""
    weight = np.zeros(len(H))
    for own, log in zip(groups, x.tolist(), strict=True):
        weight[own] = np.exp(-log)
    C = covariance_told_by(H + np.diag(weight))
    there = off - C @ (g + weight * off)
    root = np.sqrt(weight)
    told = (weight > 0.0) * np.eye(len(H)) - C * np.outer(root, root)
    score = np.array([weight[own] @ there[own] ** 2 - np.trace(told[np.ix_(own, own)])
                      for own in groups])  # fmt: skip
    inside = np.array([[np.sum(told[np.ix_(a, b)] ** 2) for b in groups] for a in groups])
    beforehand = BEFOREHAND**2
    score = 0.5 * score - beforehand * (x - begin)
    return np.linalg.solve(0.5 * inside + beforehand * np.eye(len(x)), score)
