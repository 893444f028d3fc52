"""What is known of a body beforehand, and how far a described robot is off, as the data tell it.

Parts of the described frames are off by N(0, v), v alike for all turns and for all places. With x
what they are off by, S what the data tell of them alone (all else open) and S m = s where they
would put them, the restricted likelihood of V, v of each part, is

    2 log p = s' (S + V^-1)^-1 s - log |1 + V^1/2 S V^1/2|

(Patterson, Thompson 1971). Beforehand v is log-normal, in the mean what a description is said to be
off by, its root known to a factor of three. Frames are then given the mean of v: what only they
tell is off as far in the mean as is claimed, be one part told or a hundred, while the likeliest v
is too small where few are.
"""

from collections.abc import Mapping, Sequence
from itertools import product

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
_NODES, _ROUNDS = np.arange(-3.0, 6.0), 4
"""Where the law of log v is asked, in standard deviations, as far up as the mean of v comes from,
and how often that is renewed."""


def beside_noise(
    priors: Priors, seen: TreeObservations, bends: Sequence[str], *, few: bool
) -> Priors:
    """Return those priors that count where residuals are asked for their noise.

    A robot's description says nothing there: where it is wrong, a noise that made up for that would
    make it weigh more still. What bends has priors that follow the data. But few data would be
    explained to the last digit without a description, and touches by a body of no size.

    Args:
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


def expected_priors(
    priors: Priors,
    alike: Sequence[Alike],
    names: Sequence[str],
    values: Mapping[str, float],
    white: tuple[NDArray, NDArray],
) -> Priors:
    """Return priors whose variances are the mean of what the data leave, those of a group alike.

    Args:
        alike: Groups that share one.
        names: What is free.
        values: Where `white` is.
        white: Whitened derivatives by what is free, and residuals; priors are not among them.
    """
    groups = [(own, one.sigma) for one in alike if len(own := _places(one, names))]
    if not groups:
        return priors
    own = np.concatenate([members for members, _ in groups])
    U, u = white
    pull, others = pull_of(priors, names, values), information_of(priors, names)
    others[own] = 0.0
    H, g = U.T @ U + np.diag(others), U.T @ u - others * pull
    rest = np.setdiff1d(np.arange(len(names)), own)
    taken = H[np.ix_(own, rest)] @ covariance_told_by(H[np.ix_(rest, rest)])
    S = H[np.ix_(own, own)] - taken @ H[np.ix_(rest, own)]
    asked = taken @ g[rest] - g[own] - S @ pull[own]
    of = np.repeat(np.arange(len(groups)), [len(members) for members, _ in groups])
    found = np.sqrt(_mean_variances(S, asked, of, np.array([sigma for _, sigma in groups])))
    learned = {names[i]: s for (own, _), s in zip(groups, found.tolist(), strict=True) for i in own}
    return {n: (m, learned.get(n, sigma)) for n, (m, sigma) in priors.items()}


def _places(alike: Alike, names: Sequence[str]) -> NDArray:
    """Return which of the names are in a group."""
    return np.flatnonzero(np.isin(names, alike.names))


def _mean_variances(S: NDArray, s: NDArray, of: NDArray, sigmas: NDArray) -> NDArray:
    """Return the mean of the groups' variances.

    Args:
        S: What the data tell of the parts. Shape (n, n).
        s: S times where they put them. Shape (n,).
        of: The group of each. Shape (n,).
        sigmas: What they are said to be off by. Shape (G,).
    """
    values, vectors = np.linalg.eigh(S)
    S = (vectors * np.maximum(values, 0.0)) @ vectors.T  # what nothing tells is 0 but for rounding
    spread = np.full(len(sigmas), 1.0 / BEFOREHAND)
    # The mean of exp(y), y of N(m, w^2), is exp(m + w^2 / 2).
    middle = begin = 2.0 * np.log(sigmas) - 0.5 * spread**2
    nodes, weight = begin[None], np.ones(1)
    for _ in range(_ROUNDS):
        nodes = middle + spread * np.array(list(product(_NODES, repeat=len(sigmas))))
        root = np.exp(0.5 * nodes)[:, of]
        told = np.eye(len(S)) + root[:, :, None] * S * root[:, None]
        b = (root * s)[..., None]
        log = (b * np.linalg.solve(told, b)).sum(axis=(1, 2)) - np.linalg.slogdet(told)[1]
        log -= np.sum((BEFOREHAND * (nodes - begin)) ** 2, axis=1)
        weight = np.exp(0.5 * (log - log.max()))
        weight /= weight.sum()
        middle = weight @ nodes
        spread = np.maximum(np.sqrt(weight @ (nodes - middle) ** 2), 0.5 * spread)
    return np.asarray(weight @ np.exp(nodes))
