"""What new observations tell of new parameters by a body that is known, but not exactly.

With U_m and U_b the whitened derivatives by what is new and by the body, C = L L' the body's
covariance: what is left is e + U_b b + U_z z + U_m dm, e ~ N(0, 1), b ~ N(0, C), z ~ N(0, t^2). z
is what a body that was learned stiff does not tell, and poses alike share: joints that sag stand
off their readings by part of the moment that gravity has about them, and by a constant that its
zeros took up where it was learned. How large t is the observations tell themselves; all t up to the
noise of a joint are alike beforehand, and estimates are means over them by their restricted
likelihood (REML).
"""

from collections.abc import Collection
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.estimation.tree.tree_observations import TreeObservations
from nico_selfmodel.model.arm.bending import SAG, Bending
from nico_selfmodel.model.tree.body_tree import PRISMATIC, REVOLUTE, BodyTree
from nico_selfmodel.model.tree.spread_weight import tree_rods
from nico_selfmodel.model.tree.tree_motion import TreeMotion

_GRID = 21
"""Sizes of t that means are taken over."""
_LEAST_MOMENT = 0.02
"""Part of the largest moment below which gravity turns a joint hardly at all."""
_UP = np.array([0.0, 0.0, 1.0])


@dataclass(frozen=True, eq=False)
class Drifts:
    """Ways in which joints stand off their readings."""

    names: list[str]
    """Parameters: zeros of joints, turns about their own axes, then what sags."""
    scale: NDArray
    """How much of each turns or shifts its joint by 1 rad or m, rms over the poses. (z,)."""
    bending: Bending | None
    """The body's own, or one in which nothing bends yet."""


def drifts_of(tree: BodyTree, seen: TreeObservations, learned: Collection[str] = ()) -> Drifts:
    """Return how the joints of a body may stand off their readings alike in poses alike.

    W's z points up where the body does not know what bends.

    Args:
        learned: Parameters that are learned anew, zeros among them.
    """
    read = {i for i, _ in seen.noisy_joints}
    turn = [i for i in sorted(read) if tree.motions[i] == REVOLUTE]
    shift = [i for i in sorted(read) if tree.motions[i] == PRISMATIC]
    names = [f"{tree.joints[i]}.rz" for i in turn] + [f"{tree.joints[i]}.z" for i in shift]
    names = [name for name in names if name not in learned]
    scale = np.ones(len(names))
    if tree.bending is not None or not turn:
        return Drifts(names, scale, tree.bending)
    data = seen.data
    still = TreeMotion.at(tree, np.zeros((1, len(tree.joints))), data.X_flange[:1])
    bending = Bending.none(tree.joints, _UP, *tree_rods(still)).with_effects(SAG)
    motion = TreeMotion.at(replace(tree, bending=bending), data.si_readings, data.X_flange)
    assert motion.load is not None
    about = np.sqrt(np.mean(motion.load.moments[:, :, 2] ** 2, axis=1))
    sags = [i for i in turn if about[i] > _LEAST_MOMENT * about.max()]
    names += [f"{tree.joints[i]}.{SAG}" for i in sags]
    return Drifts(names, np.append(scale, 1.0 / about[sags]), bending)


@dataclass(frozen=True, eq=False)
class NewParameters:
    """Parameters that are new, by a body that errs."""

    step: NDArray
    """How far to move them. Shape (p,)."""
    covariance: NDArray
    """Of them, along directions that anything tells. Shape (p, p)."""
    information: NDArray
    """Inverse of the covariance. Shape (p, p)."""
    with_body: NDArray
    """Covariance of them and the body's errors in its own sigmas, L^-1 b. Shape (p, k)."""
    drift: float
    """Expected t."""
    squares: float
    """Sum of the squares that are left, w' S^-1 w, S what noise and body's errors let expect."""


def new_parameters(
    U_m: NDArray, A: NDArray, U_z: NDArray, white: NDArray, largest: float
) -> NewParameters:
    """Estimate new parameters.

    Args:
        U_m: Whitened derivatives by what is new. Shape (R, p).
        A: Those by the body's errors in its own sigmas, U_b L. Shape (R, k).
        U_z: Those by how joints stand off their readings [1/rad or 1/m]. Shape (R, z).
        white: Whitened residuals, predicted minus measured. Shape (R,).
        largest: t is no larger than that.
    """
    p, k = U_m.shape[1], A.shape[1]
    everything = np.hstack([U_m, white[:, None], A, U_z])
    gram = everything.T @ everything
    sizes = np.linspace(0.0, largest, _GRID if U_z.shape[1] and largest > 0.0 else 1)
    found = [_at(gram, p, k, t) for t in sizes.tolist()]
    weight = np.array([one[0] for one in found])
    weight = np.exp(weight - weight.max())
    weight /= weight.sum()
    steps = np.array([one[1] for one in found])
    step = weight @ steps
    apart = steps - step
    covariance = np.einsum("t,tij->ij", weight, np.array([one[2] for one in found]))
    covariance += np.einsum("t,ti,tj->ij", weight, apart, apart)
    with_body = np.einsum("t,tij->ij", weight, np.array([one[3] for one in found]))
    information = np.linalg.pinv(covariance, rcond=1e-12, hermitian=True)
    squares = float(weight @ np.array([one[4] for one in found]))
    return NewParameters(step, covariance, information, with_body, float(weight @ sizes), squares)


def _at(gram: NDArray, p: int, k: int, t: float) -> tuple[float, NDArray, NDArray, NDArray, float]:
    """Return log likelihood, step, covariance and that with the body, and squares, for one t.

    S = 1 + B B', B = (A, t U_z): X' S^-1 Y = X'Y - X'B (1 + B'B)^-1 B'Y.
    """
    size = np.ones(len(gram))
    size[p + 1 + k :] = t
    gram = gram * np.outer(size, size)
    first, last = slice(0, p + 1), slice(p + 1, None)
    inner = np.eye(len(gram) - p - 1) + gram[last, last]
    weighed = gram[first, first] - gram[first, last] @ np.linalg.solve(inner, gram[last, first])
    information = weighed[:p, :p]
    covariance = np.linalg.pinv(information, rcond=1e-12, hermitian=True)
    step = -covariance @ weighed[:p, p]
    squares = weighed[p, p] + step @ weighed[:p, p]
    determinants = np.linalg.slogdet(inner)[1] + np.linalg.slogdet(information)[1]
    # U_m' S^-1 A = U_m'A - U_m'B (1 + B'B)^-1 B'A
    body = slice(p + 1, p + 1 + k)
    across = gram[:p, body] - gram[:p, last] @ np.linalg.solve(inner, gram[last, body])
    likelihood = -0.5 * (squares + determinants)
    return likelihood, step, covariance, -covariance @ across, float(squares)
