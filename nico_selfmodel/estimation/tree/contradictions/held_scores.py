"""Whether a recording contradicts lenses and lengths that it is told.

Score tests (Rao 1948): with U the whitened derivatives by what was free, Z those by what was held,
Z is taken off U, and where what was held is right the fall of the squares z'Z (Z'Z)^-1 Z'z is chi
square of the number of columns. Nothing is solved again. Those of arms are in
`estimation.diagnosis.score_test`.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.dataset.body.sensors import DISTANCE, POINTS, POSES
from nico_selfmodel.estimation.results.calibration_result import CAUSE, WARNING
from nico_selfmodel.estimation.tree.forward.tree_linear import TreeLinear
from nico_selfmodel.estimation.tree.tree_observations import TreeObservations
from nico_selfmodel.estimation.tree.tree_problem import TreeProblem
from nico_selfmodel.estimation.tree.tree_solution import TreeSolution
from nico_selfmodel.optimization.chi_square import chi_square_tail

LENS_PARTS = ("fx", "fy", "cx", "cy")
"""Numbers of a lens that are asked for."""
_TOLD = 1e-3
"""Share of a column that must be left beside what was free for it to be told apart."""
_CHANCE = 1e-6
"""How often noise alone may contradict what is held."""
_SHARE = 0.1
"""Part of a sensor's squares from which on what is held is a fault; fixed lenses that were 5 % off
took 0.66, a board 2 % too large 0.43, right ones of bodies that sag unknown to them 0.003."""


@dataclass(frozen=True, eq=False)
class HeldScore:
    """What the residuals say of some numbers that were held."""

    gain: float
    """Fall of the whitened squares if they were free, in units of their mean; 0 where untold."""
    values: NDArray
    """Where they would go, from where they are held. Shape (e,)."""
    sigma: NDArray
    """Standard deviations of that. Shape (e,)."""


def held_scores(problem: TreeProblem, solution: TreeSolution) -> dict[str, HeldScore]:
    """Return where what is said of sensors would go if the recording were asked.

    Args:
        problem: What was solved.
        solution: Where it ended.

    Returns:
        Sensor -> of a camera whose lens was held, the score of fx, fy, cx and cy [px]; of others
        that of the logarithm of the factor by which what they measure is too long.
    """
    linear = problem.residuals.linear(solution.values)
    columns = {**_by_lenses(problem, linear), **_by_lengths(problem.observations, linear)}
    if not columns:
        return {}
    at = np.cumsum([0, *(one.shape[1] for one in columns.values())])
    Z, z, redundancy = _beside(problem, solution, np.hstack(list(columns.values())))
    variance = max(float(z @ z) / redundancy, np.finfo(float).tiny)
    return {
        name: _score(Z[:, first:last], z, variance)
        for name, first, last in zip(columns, at[:-1], at[1:], strict=True)
    }


def _by_lenses(problem: TreeProblem, linear: TreeLinear) -> dict[str, NDArray]:
    """Return derivatives by focal lengths and middles of lenses that were held. (R, 4) each."""
    parameters, found = problem.residuals.parameters, {}
    seeing = {s.name for s in problem.observations.sensors}
    for name in parameters.base.lenses:
        inside = [f"{name}.{part}" for part in ("fx", "fy", "cx", "cy")]
        if name in seeing and not set(inside) & set(problem.free_names):
            found[name] = linear.J[[parameters.index[one] for one in inside]].T
    return found


def _by_lengths(seen: TreeObservations, linear: TreeLinear) -> dict[str, NDArray]:
    """Return derivatives of r = factor predicted - measured by the factor's logarithm. (R, 1) each.

    By what is predicted: where the sensor itself tells how large the body is, the body's size does
    the same to all of it, and nothing is left of the column.
    """
    all_left = linear.r if linear.pulled is None else linear.r + linear.pulled
    found = {}
    for rows in seen.sensors:
        if rows.kind in (DISTANCE, POINTS, POSES):
            column = np.zeros((seen.scalars, 1))
            own = column[rows.scalars].reshape(rows.measured.shape)
            left = all_left[rows.scalars].reshape(rows.measured.shape)
            lengths = 1 if rows.kind == DISTANCE else 3
            own[:, :lengths] = (rows.measured + left)[:, :lengths]
            found[rows.name] = column
    return found


def _beside(
    problem: TreeProblem, solution: TreeSolution, columns: NDArray
) -> tuple[NDArray, NDArray, int]:
    """Return whitened columns and residuals with what was free taken off, and the redundancy."""
    U, white = problem.whitened_at(solution, columns)
    free, e = len(problem.free_names), columns.shape[1]
    prior = solution.whitened[len(white) :]
    U = np.vstack([U, np.hstack([prior, np.zeros((len(prior), e))])])
    z = np.append(white, solution.rest[len(white) :])
    U, Z = U[:, :free], U[:, free:]
    U = U / np.maximum(np.linalg.norm(U, axis=0), np.finfo(float).tiny)
    taken = np.linalg.lstsq(U.T @ U, U.T @ np.column_stack([Z, z]), rcond=1e-12)[0]
    rest = np.column_stack([Z, z]) - U @ taken
    told = np.linalg.norm(rest[:, :-1], axis=0) > _TOLD * np.linalg.norm(Z, axis=0)
    return rest[:, :-1] * told, rest[:, -1], max(len(z) - free, 1)


def _score(Z: NDArray, z: NDArray, variance: float) -> HeldScore:
    size = np.linalg.norm(Z, axis=0)
    e = len(size)
    if not size.all():
        return HeldScore(0.0, np.zeros(e), np.full(e, np.inf))
    Z = Z / size
    inner = np.linalg.pinv(Z.T @ Z, rcond=_TOLD**2, hermitian=True)
    values = -inner @ (Z.T @ z)
    gain = float(values @ (Z.T @ Z) @ values) / variance
    return HeldScore(gain, values / size, np.sqrt(variance * np.diag(inner)) / size)


def severity_of(score: HeldScore, scalars: int) -> str:
    """Return how much a score says against what is held: `CAUSE`, `WARNING` or nothing.

    Args:
        score: Of the numbers.
        scalars: How many numbers their sensor measured.
    """
    if chi_square_tail(score.gain, len(score.values)) > _CHANCE:
        return ""
    return CAUSE if score.gain > _SHARE * scalars else WARNING
