"""What no pose of a body tells: ways its parameters can change of which nothing is ever seen.

A hand that a parallelogram keeps upright may sit higher and its shoulder lower. The recording is
not to blame: wherever else the joints may be, what is seen of the body is nearly the same. So the
derivatives of the recording are put beside those of the same sights with readings drawn between the
joints' limits, as many again; what these leave open, too, no recording of this body by these
sensors tells, and nothing that they see hangs on it. Cameras are taken to see all around, by
bearings: what is open even so they never see.
"""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.estimation.tree.forward.tree_residuals import TreeResiduals
from nico_selfmodel.estimation.tree.tree_observations import TreeObservations
from nico_selfmodel.estimation.tree.tree_problem import TreeProblem
from nico_selfmodel.estimation.tree.tree_solution import TreeSolution
from nico_selfmodel.model.tree.body_tree import REVOLUTE, WHOLE_POSES
from nico_selfmodel.optimization.uncertainty import Uncertainty

_TURN, _SHIFT = np.pi, 1.0
"""How far from zero joints may go of which no limits are known [rad, m]."""
_WITHIN = 0.9
"""Squared share of a way within what is left open from which on it is left open."""


def told_by_no_pose(
    known: Uncertainty, problem: TreeProblem, solution: TreeSolution, natural: NDArray
) -> tuple[bool, ...]:
    """Return which unobservable directions stay so however the joints are.

    Args:
        known: How well the body is known.
        problem: What was solved.
        solution: Where it ended.
        natural: Natural scale of each free parameter. Shape (k,).

    Returns:
        One for each of `known.unobservable`; False of bodies with poses that are read or learned as
        a whole, which are drawn from no joints, and of lenses, which pictures would tell.
    """
    data, lenses = problem.observations.data, problem.residuals.parameters.layout.of_lenses
    whole = any(joint.motion in WHOLE_POSES for joint in data.joints)
    if not known.unobservable or whole:
        return (False,) * len(known.unobservable)
    elsewhere = _elsewhere(problem, solution, np.random.default_rng(0))
    # They tell as much in all: noise of joints, which pictures do not show apart, is in neither.
    elsewhere *= np.linalg.norm(solution.whitened * natural) / np.linalg.norm(elsewhere * natural)
    rows = np.vstack([solution.whitened, elsewhere])
    # Twice the poses make sigmas 1.4 times smaller: half of what is open stays open.
    scale, count = 0.5 * natural, len(rows)
    still = Uncertainty.from_jacobian(known.names, rows, scale, float(count), count)
    left = np.array([_shares(known.names, way.names, way.shares) for way in still.unobservable])
    if not len(left):
        return (False,) * len(known.unobservable)
    basis = np.linalg.svd(left, full_matrices=False)[2]
    ways = [_shares(known.names, way.names, way.shares) for way in known.unobservable]
    seen = [bool(lenses & set(way.names)) for way in known.unobservable]
    return tuple(
        float(np.sum((basis @ way) ** 2)) > _WITHIN and not lens
        for way, lens in zip(ways, seen, strict=True)
    )


def _shares(names: tuple[str, ...], own: tuple[str, ...], shares: NDArray) -> NDArray:
    """Return a direction among all parameters, of unit length. Shape (k,)."""
    found = np.zeros(len(names))
    found[[names.index(name) for name in own]] = shares
    return found / np.linalg.norm(found)


def _elsewhere(problem: TreeProblem, solution: TreeSolution, rng: np.random.Generator) -> NDArray:
    """Return derivatives of the same sights with the joints elsewhere, in sigmas. Shape (r, k)."""
    data, parameters = problem.observations.data, problem.residuals.parameters
    per_unit = np.array([joint.si_per_unit for joint in data.joints])
    far = np.array([_TURN if j.motion == REVOLUTE else _SHIFT for j in data.joints]) / per_unit
    lower = [-x if j.lower is None else j.lower for j, x in zip(data.joints, far, strict=True)]
    upper = [x if j.upper is None else j.upper for j, x in zip(data.joints, far, strict=True)]
    drawn = rng.uniform(lower, upper, data.readings.shape)
    readings = np.where(np.isfinite(data.readings), drawn, np.nan)
    lenses = parameters.tree_of(solution.values).lenses
    seen = TreeObservations.of(replace(data, readings=readings)).as_bearings(lenses)
    J = TreeResiduals(seen, parameters).linear(solution.values).J[problem.columns]
    return np.asarray((J / seen.stated_sigma[seen.noise_group]).T)
