"""Which poses to record: few that tell much, chosen from a pool by the estimator's own Jacobians.

Greedy choice, then exchange of single poses as long as that helps (DETMAX). `D` maximises the
determinant of the information about the parameters; `I` minimises the mean variance of the
predicted hand over the poses that matter.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.blas_threads import on_one_blas_thread
from nico_selfmodel.errors import DataError, NotIdentifiableError
from nico_selfmodel.names import refuse_unknown

CRITERIA = ("I", "D")
_RIDGE = 1e-6
"""What is known of a scaled parameter before the first pose, so that a start exists."""
_PASSES = 10
_ENDS = 0.5
"""Of the beta distribution of a pool: the poses that tell most lie near the ends of the joints'
ranges, as for polynomials (arcsine law)."""
_SINGULAR = 1e-10


@dataclass(frozen=True, eq=False)
class PoseChoice:
    """Chosen poses and what they are worth."""

    rows: NDArray
    """Rows of the pool, in the order of their choice. Shape (K,)."""
    hand_sigma: float
    """Root mean square error of what is predicted over the targets, in their unit."""
    information: float
    """(det of the information)^(1/p) / K on scaled parameters: O1 squared of the literature."""
    exchanges: int
    """Poses that were exchanged after the greedy choice."""


@dataclass(frozen=True, eq=False)
class NextPoses:
    """Poses worth recording."""

    readings: NDArray
    """Encoder readings to go to, in the encoders' own units. Shape (K, n)."""
    sigma_before: float
    """Root mean square error of what is predicted over the recorded poses, as the model is."""
    sigma_after: float
    """The same once these poses are recorded too."""
    choice: PoseChoice
    """How they were chosen."""
    unit: str = "m"
    """Of the errors."""


def drawn_between(recorded: NDArray, count: int, rng: np.random.Generator) -> NDArray:
    """Draw poses between readings that were recorded. Shapes (N, n) -> (count, n).

    Raises:
        DataError: If they are all one pose.
    """
    low, high = recorded.min(axis=0), recorded.max(axis=0)
    if not (high > low).any():
        raise DataError(
            "all recorded poses are one, and nothing lies between them: give a recording that "
            "covers where the robot may go"
        )
    return low + (high - low) * rng.beta(_ENDS, _ENDS, (count, len(low)))


@on_one_blas_thread
def choose_poses(
    jacobians: NDArray,
    count: int,
    *,
    criterion: str = "I",
    targets: NDArray | None = None,
    given: NDArray | None = None,
) -> PoseChoice:
    """Choose poses from a pool.

    Args:
        jacobians: Of what each pose of the pool shows, in units of its noise. Shape (N, k, p).
        criterion: `D`, or `I` for the prediction over the targets.
        targets: Jacobians of the poses that must be predicted well; the pool's by default.
            Shape (M, 3, p).
        given: Jacobians of poses that are recorded anyway, such as circles. Shape (G, k, p).

    Raises:
        NotIdentifiableError: If no choice determines the parameters.
        ValueError: If a shape, the number or the criterion is wrong.
    """
    jacobians = _checked(jacobians, count, criterion)
    targets = jacobians if targets is None else np.asarray(targets, dtype=float)
    p = jacobians.shape[2]
    G = np.einsum("nki,nkj->ij", targets, targets) / len(targets)
    base = _RIDGE * np.eye(p)
    if given is not None:
        base = base + np.einsum("nki,nkj->ij", given, given)
    H, rows = base.copy(), []
    for _ in range(count):
        gain = _gain(jacobians, np.linalg.inv(H), G, criterion)
        gain[rows] = -np.inf
        rows.append(int(np.argmax(gain)))
        H += jacobians[rows[-1]].T @ jacobians[rows[-1]]
    exchanges = _exchange(jacobians, rows, H, G, criterion)
    return _choice(jacobians, rows, base - _RIDGE * np.eye(p), G, exchanges)


def hand_sigma(recorded: NDArray, targets: NDArray) -> float:
    """Return the error of the predicted hand that recorded poses leave, sqrt(tr G H^-1).

    Args:
        recorded: Jacobians of the recorded poses. Shape (N, k, p).
        targets: Jacobians of the poses that must be predicted well. Shape (M, 3, p).

    Returns:
        Root mean square over the targets, in their unit, where the recorded ones are in units of
        their noise; infinite where these do not determine the parameters.
    """
    H = np.einsum("nki,nkj->ij", recorded, recorded)
    if _is_singular(H):
        return np.inf
    G = np.einsum("nki,nkj->ij", targets, targets) / len(targets)
    return float(np.sqrt(np.trace(G @ np.linalg.inv(H))))


def _checked(jacobians: NDArray, count: int, criterion: str) -> NDArray:
    jacobians = np.asarray(jacobians, dtype=float)
    if jacobians.ndim != 3:
        raise ValueError(f"jacobians must have shape (N, 3, p), got {jacobians.shape}")
    if not 1 <= count <= len(jacobians):
        raise ValueError(f"count must be from 1 to {len(jacobians)}, the pool's size, got {count}")
    refuse_unknown("criterion", criterion, CRITERIA)
    return jacobians


def _gain(J: NDArray, inverse: NDArray, G: NDArray, criterion: str) -> NDArray:
    """Return what each pose of the pool would add, by its update of low rank. Shape (N,)."""
    JC = J @ inverse
    inner = np.eye(J.shape[1]) + JC @ np.swapaxes(J, 1, 2)
    if criterion == "D":
        return np.linalg.slogdet(inner)[1]
    return np.einsum("nij,nji->n", np.linalg.inv(inner), JC @ G @ np.swapaxes(JC, 1, 2))


def _exchange(J: NDArray, rows: list[int], H: NDArray, G: NDArray, criterion: str) -> int:
    """Take each pose out in turn and put the best one in its place, until nothing changes."""
    changed = 0
    for _ in range(_PASSES):
        before = changed
        for k in range(len(rows)):
            H -= J[rows[k]].T @ J[rows[k]]
            gain = _gain(J, np.linalg.inv(H), G, criterion)
            others = rows[:k] + rows[k + 1 :]
            gain[others] = -np.inf
            best = int(np.argmax(gain))
            if best != rows[k] and gain[best] > gain[rows[k]] * (1.0 + 1e-9):
                rows[k] = best
                changed += 1
            H += J[rows[k]].T @ J[rows[k]]
        if changed == before:
            break
    return changed


def _is_singular(H: NDArray) -> bool:
    """Whether nothing tells some direction, however well others are known beforehand."""
    size = np.sqrt(np.diag(H))
    if not np.all(size > 0.0):
        return True
    values = np.linalg.eigvalsh(H / np.outer(size, size))
    return bool(values[0] < _SINGULAR * values[-1])


def _choice(J: NDArray, rows: list[int], given: NDArray, G: NDArray, exchanges: int) -> PoseChoice:
    H = given + np.einsum("nki,nkj->ij", J[rows], J[rows])
    values = np.linalg.eigvalsh(H)
    if _is_singular(H):
        raise NotIdentifiableError(
            f"{len(rows)} poses do not determine the {len(H)} parameters: choose at least "
            f"{-(-len(H) // J.shape[1])}, from a pool in which every joint moves"
        )
    row = np.array(rows)
    row.flags.writeable = False
    return PoseChoice(
        row,
        float(np.sqrt(np.trace(G @ np.linalg.inv(H)))),
        float(np.exp(np.mean(np.log(values)))) / len(rows),
        exchanges,
    )
