"""Which parameters too few poses leave open, by name."""

import numpy as np

from nico_selfmodel.estimation.body.body_uncertainty import natural_of
from nico_selfmodel.estimation.tree.tree_problem import TreeProblem
from nico_selfmodel.optimization.uncertainty import Uncertainty


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
    natural = natural_of(problem, size)
    found = Uncertainty.from_jacobian(problem.free_names, rows, natural, 0.0, 0)
    share = dict.fromkeys(found.names, 0.0)
    for direction in found.unobservable:
        for name, part in zip(direction.names, direction.shares.tolist(), strict=True):
            share[name] += part**2
    unknown = np.array(found.names)[~np.isfinite(found.sigma)].tolist()
    return tuple(sorted(unknown, key=lambda name: -share[name]))
