"""Whether a recording contradicts lenses and lengths that it is told.

Score tests (Rao 1948): with U the whitened derivatives by what was free, Z those by what was held,
Z is taken off U, and where what was held is right the fall of the squares z'Z (Z'Z)^-1 Z'z is chi
square of the number of columns. Nothing is solved again. Those of arms are in
`estimation.diagnosis.score_test`.

A description whose standard deviation is learned is said to be far off where a length that is told
wrongly contradicts it. Its squares S_0 beside what is held, and S_1 if that were free, tell: where
the data tell nu + 1 of its parts (one less the leverage of each, summed; MacKay 1992),
nu (S_0 - S_1) / S_1 is t^2 of nu freedoms, as rare as chi square of one,
((8 nu + 1) / (8 nu + 3))^2 nu log(S_0 / S_1) (Wallace 1959). S_0 itself is no such number: of a
standard deviation that is said to be too large, and learned, it is six of nine.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.dataset.body.sensors import DISTANCE, POINTS, POSES
from nico_selfmodel.estimation.results.calibration_result import CAUSE, FAILURE, WARNING
from nico_selfmodel.estimation.tree.boards.poses_apart import PosesApart
from nico_selfmodel.estimation.tree.forward.tree_linear import TreeLinear
from nico_selfmodel.estimation.tree.known.lens_parts import (
    CHANCE,
    TOLD,
    LensPart,
    lens_columns,
    wrong_parts,
)
from nico_selfmodel.estimation.tree.known.size_beside_noise import SizeBesideNoise
from nico_selfmodel.estimation.tree.tree_observations import TreeObservations
from nico_selfmodel.estimation.tree.tree_problem import TreeProblem
from nico_selfmodel.estimation.tree.tree_solution import TreeSolution
from nico_selfmodel.optimization.chi_square import chi_square_tail

_CHANCE_DESCRIBED = 1e-3
"""How often a sound description may contradict it, of which hardly more than its parts tell."""
_FAILS, _FAR = 5e-4, 0.02
"""And how often a size that is stated may, and be off by so much, before it fails: all that is
learned is as much too large. By less a printer or a ruler is off."""
_SHARE = 0.1
"""Part of a sensor's squares from which on what is held is a fault; a board 2 % too large
took 0.43, right lenses of bodies that sag unknown to them 0.003."""


@dataclass(frozen=True, eq=False)
class HeldScore:
    """What the residuals say of some numbers that were held."""

    gain: float
    """Fall of the whitened squares if they were free, in units of their mean; 0 where untold."""
    values: NDArray
    """Where they would go, from where they are held. Shape (e,)."""
    sigma: NDArray
    """Standard deviations of that. Shape (e,)."""
    scalars: int
    """How many numbers were measured of what is held."""
    beside_description: float = 0.0
    """Chi square of one freedom that is as rare as how far off a description had to be."""
    stated: bool = False
    """Whether it is a size that somebody stated, of a tag or board; a tracker has its own."""


def held_scores(
    problem: TreeProblem, solution: TreeSolution
) -> tuple[dict[str, HeldScore], tuple[LensPart, ...]]:
    """Return where what is said of sensors would go if the recording were asked.

    Args:
        problem: What was solved.
        solution: Where it ended.

    Returns:
        Sensor -> the score of the logarithm of the factor by which what it measures is too long;
        and by `size_of` a board or `target_on` a link that of the factor by which it is told too
        large. Then what is wrong of lenses that were held.
    """
    seen = problem.observations
    linear = problem.residuals.linear(solution.values, problem.poses)
    targets = _by_places(problem, linear)
    sizes = {**_by_sizes(seen, linear), **targets}
    both = replace(linear, J=np.vstack([linear.J, *sizes.values()]))
    alone = PosesApart.of(seen, ~solution.outliers[seen.row]).eliminated(both, problem.scale)
    lenses, columns = lens_columns(problem, alone), _by_lengths(seen, linear)
    columns |= dict(zip(sizes, alone.J[len(linear.J) :], strict=True))
    if not lenses and not columns:
        return {}, ()
    described = _described(problem, len(solution.whitened))
    asked = np.column_stack([*lenses.values(), *columns.values()])
    Z, z, redundancy, told = _beside(problem, solution, asked, described)
    variance = max(float(z @ z) / redundancy, np.finfo(float).tiny)
    scores, of_poses = {}, {rows.name for rows in seen.sensors if rows.kind == POSES}
    for (name, column), own in zip(columns.items(), Z[:, len(lenses) :].T, strict=True):
        scalars = int(np.count_nonzero(column))
        if name in targets:
            scalars = min(scalars, 6 * _sights(seen, column))
        score = _score(own, z, variance, scalars, described, told - 1.0)
        score = replace(score, stated=name in sizes or name in of_poses)
        scores[name] = _beside_noise(score, problem, solution, column)
    return scores, wrong_parts(lenses, Z[:, : len(lenses)], z, redundancy)


def size_of(board: str) -> str:
    """Return what the score of a board's size is called."""
    return f"board {board!r}"


def target_on(link: str) -> str:
    """Return what the score of places that are told of a link's markers is called."""
    return f"target on {link!r}"


def _described(problem: TreeProblem, rows: int) -> NDArray:
    """Return which whitened rows hold places of a description of learned size. Boolean, (rows,)."""
    out = np.zeros(rows, dtype=bool)
    if problem.alike:
        known = [name for name in problem.free_names if name in problem.priors]
        out[rows - len(known) :] = np.isin(known, problem.alike[-1].names)
    return out


def _by_lengths(seen: TreeObservations, linear: TreeLinear) -> dict[str, NDArray]:
    """Return derivatives of r = factor predicted - measured by the factor's logarithm. (R,) each.

    By what is predicted: where the sensor itself tells how large the body is, the body's size does
    the same to all of it, and nothing is left of the column.
    """
    all_left = linear.r if linear.pulled is None else linear.r + linear.pulled
    found = {}
    for rows in seen.sensors:
        if rows.kind in (DISTANCE, POINTS, POSES):
            column = np.zeros(seen.scalars)
            own = column[rows.scalars].reshape(rows.measured.shape)
            left = all_left[rows.scalars].reshape(rows.measured.shape)
            lengths = 1 if rows.kind == DISTANCE else 3
            own[:, :lengths] = (rows.in_sight + left)[:, :lengths]
            found[rows.name] = column
    return found


def _by_sizes(seen: TreeObservations, linear: TreeLinear) -> dict[str, NDArray]:
    """Return derivatives by the logarithm of how much larger a board is told. (R,) each."""
    data, marker, found = seen.data, seen.data.observations.marker[seen.row], dict[str, NDArray]()
    if linear.poses is None:
        return found
    place = np.array([m.xyz or (0.0, 0.0, 0.0) for m in data.markers])
    for i in data.free_joints:
        shift = seen.noisy_joints.index((i, 3)) + np.arange(3)
        R = linear.poses[seen.sample, i, :3, :3]
        off = np.sum(linear.by_joint[:, shift] * np.einsum("rij,rj->ri", R, place[marker]), axis=1)
        found[size_of(data.joints[i].name)] = np.where(data.seen_on[seen.row] == i, -off, 0.0)
    return found


def _by_places(problem: TreeProblem, linear: TreeLinear) -> dict[str, NDArray]:
    """Return derivatives by the logarithm of how much too large places are told. (R,) each.

    Of each link, and of the world, on which places of markers are held as they are told.
    """
    index, free = problem.residuals.parameters.index, set(problem.free_names)
    data, found = problem.observations.data, dict[str, NDArray]()
    for marker in data.markers:
        names = [f"{marker.name}.{part}" for part in "xyz"]
        if marker.xyz is None or names[0] not in index or free & set(names):
            continue
        row = -np.array(marker.xyz) @ linear.J[[index[name] for name in names]]
        key = target_on(marker.on)
        found[key] = found.get(key, 0.0) + row
    return found


def _sights(seen: TreeObservations, column: NDArray) -> int:
    """Return in how many sights a target was seen.

    The shape in one says nothing of lengths, only where the target is: six numbers.
    """
    table, rows = seen.data.observations, np.unique(seen.row[column != 0.0])
    return len(np.unique(np.stack([table.pose[rows], table.sensor[rows]]), axis=1).T)


def _beside(
    problem: TreeProblem, solution: TreeSolution, columns: NDArray, described: NDArray
) -> tuple[NDArray, NDArray, int, float]:
    """Return whitened columns and residuals with what was free taken off, and the redundancy.

    The last is how many of the described rows the others tell.
    """
    U, white = problem.whitened_at(solution, columns)
    free, e = len(problem.free_names), columns.shape[1]
    prior = solution.whitened[len(white) :]
    U = np.vstack([U, np.hstack([prior, np.zeros((len(prior), e))])])
    z = np.append(white, solution.rest[len(white) :])
    U, Z = U[:, :free], U[:, free:]
    U = U / np.maximum(np.linalg.norm(U, axis=0), np.finfo(float).tiny)
    both, own = np.column_stack([Z, z]), U[described]
    taken = np.linalg.lstsq(U.T @ U, np.column_stack([U.T @ both, own.T]), rcond=1e-12)[0]
    rest = both - U @ taken[:, : e + 1]
    told = np.linalg.norm(rest[:, :-1], axis=0) > TOLD * np.linalg.norm(Z, axis=0)
    by_others = len(own) - float(np.sum(own.T * taken[:, e + 1 :]))
    return rest[:, :-1] * told, rest[:, -1], max(len(z) - free, 1), by_others


def _score(
    Z: NDArray, z: NDArray, variance: float, scalars: int, described: NDArray, freedoms: float
) -> HeldScore:
    size = float(np.linalg.norm(Z))
    if not size:
        return HeldScore(0.0, np.zeros(1), np.full(1, np.inf), scalars)
    Z = Z / size
    value = -float(Z @ z)
    before, after = (float(np.sum(one[described] ** 2)) for one in (z, z + Z * value))
    sigma, rare = np.sqrt(variance) / size, 0.0
    if freedoms > 1.0 and after < before:
        rare = ((8 * freedoms + 1) / (8 * freedoms + 3)) ** 2 * freedoms * np.log(before / after)
        sigma = sigma * np.sqrt(after / freedoms)
    value_at, sigmas = np.array([value / size]), np.array([sigma])
    return HeldScore(value**2 / variance, value_at, sigmas, scalars, rare)


def _beside_noise(
    score: HeldScore, problem: TreeProblem, solution: TreeSolution, column: NDArray
) -> HeldScore:
    """Return what a size says of itself beside a flange's noise, where that is more."""
    sights = _sights(problem.observations, column)
    found = SizeBesideNoise.of(problem, solution, column, sights, CHANCE)
    if found is None or found.gain < score.gain:
        return score
    value, sigma = np.array([found.value]), np.array([found.sigma])
    return replace(score, gain=found.gain, values=value, sigma=sigma)


def severity_of(score: HeldScore) -> str:
    """Return what a score says against what is held: `CAUSE`, `FAILURE`, `WARNING` or nothing."""
    sound = chi_square_tail(score.gain, len(score.values)) > CHANCE
    described = chi_square_tail(score.beside_description, 1)
    if sound and described > _CHANCE_DESCRIBED:
        return ""
    if score.gain > _SHARE * score.scalars:
        return CAUSE
    far = score.stated and float(np.abs(score.values).max()) > _FAR
    return FAILURE if far and described < _FAILS else WARNING
