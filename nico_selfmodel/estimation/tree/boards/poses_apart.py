"""What no joint moves, its own poses eliminated before poses of the body are weighed.

A board before cameras that stand shares nothing with a pose of the body. Of its residuals r in
their sensors' sigmas, A their derivatives by its own pose, what no pose explains counts:

    r <- (I - A A^+) r,   J <- (I - A A^+) J,

with as many freedoms less as A has columns. Each row then stands for itself, however many a board
has.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.estimation.tree.forward.tree_linear import TreeLinear
from nico_selfmodel.estimation.tree.tree_observations import TreeObservations


@dataclass(frozen=True, eq=False)
class PosesApart:
    """Which scalars belong to one pose of what moves freely, before sensors that stand."""

    scalars: NDArray
    """Those that count. Shape (S,)."""
    board: NDArray
    """Number of each one's pose. Shape (S,)."""
    slot: NDArray
    """Place of each one among those of its pose. Shape (S,)."""
    columns: NDArray
    """Columns of `TreeLinear.by_joint` that are parts of its pose. Shape (S, 6)."""
    group: NDArray
    """Its `TreeObservations.noise_group`. Shape (S,)."""
    groups: int
    """How many of these there are, G."""
    apart: NDArray
    """All scalars that no joint moves, whether they count or not. Boolean, shape (R,)."""

    @classmethod
    def of(cls, seen: TreeObservations, keep: NDArray) -> "PosesApart":
        """Find them among scalars that count. Boolean, shape (R,)."""
        scalars = np.flatnonzero(seen.apart & keep)
        joint = seen.data.seen_on[seen.row[scalars]]
        of_pose = seen.sample[scalars] * len(seen.data.joints) + joint
        board = np.unique(of_pose, return_inverse=True)[1].reshape(len(scalars))
        order = np.argsort(board, kind="stable")
        counts = np.bincount(board)
        slot = np.empty(len(board), dtype=int)
        slot[order] = np.arange(len(board)) - np.repeat(np.cumsum(counts) - counts, counts)
        first = np.array([seen.noisy_joints.index((i, 0)) for i in seen.data.free_joints], int)
        own = first[np.searchsorted(seen.data.free_joints, joint)] if len(joint) else joint
        columns = own[:, None] + np.arange(6)
        groups = len(seen.noise_groups)
        group = seen.noise_group[scalars]
        return cls(scalars, board, slot, columns, group, groups, seen.apart)

    def eliminated(self, linear: TreeLinear, sigma: NDArray) -> TreeLinear:
        """Return residuals and derivatives without what the poses themselves explain.

        Args:
            linear: Of all that was seen.
            sigma: Standard deviation of each scalar's sensor. Shape (R,).
        """
        if not len(self.scalars):
            return linear
        own, s = self.scalars, sigma[self.scalars]
        A = linear.by_joint[own[:, None], self.columns] / s[:, None]
        Q = np.linalg.qr(self._by_board(A))[0]
        moved = np.flatnonzero((linear.J[:, own] != 0.0).any(axis=1))
        both = np.concatenate([linear.r[None, own], linear.J[np.ix_(moved, own)]]).T / s[:, None]
        x = self._by_board(both)
        left = (x - Q @ (np.swapaxes(Q, 1, 2) @ x))[self.board, self.slot] * s[:, None]
        r, J, by_joint = linear.r.copy(), linear.J.copy(), linear.by_joint.copy()
        r[own], by_joint[self.apart] = left[:, 0], 0.0
        J[np.ix_(moved, own)] = left[:, 1:].T
        took = np.zeros((len(r), Q.shape[2]))
        took[own] = Q[self.board, self.slot]
        taken = np.bincount(self.group, np.sum(took[own] ** 2, axis=1), minlength=self.groups)
        return replace(linear, r=r, J=J, by_joint=by_joint, taken=taken, took=took)

    def _by_board(self, values: NDArray) -> NDArray:
        """Return rows by pose, zero where there is none. Shape (S, c) -> (boards, most, c)."""
        out = np.zeros((self.board.max() + 1, self.slot.max() + 1, values.shape[1]))
        out[self.board, self.slot] = values
        return out
