"""What turns and shifts of a body's parts do to what sensors show of its markers."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.estimation.tree.forward.rows_last import at_samples, consecutive, dot_first
from nico_selfmodel.estimation.tree.forward.sensor_run import AttachedEnds, Sight
from nico_selfmodel.geometry.rotation import skew
from nico_selfmodel.model.arm.bending_slopes import Bent, bending_slopes
from nico_selfmodel.model.arm.line_kinematics import cross
from nico_selfmodel.model.tree.body_tree import PRISMATIC, REVOLUTE
from nico_selfmodel.model.tree.tree_load import carries
from nico_selfmodel.model.tree.tree_motion import TreeMotion


@dataclass(frozen=True, eq=False)
class Push:
    """What turns and shifts in W do to the residuals of one sensor's rows."""

    shift: NDArray
    """By a shift of the marker in W. Shape (N, k, 3)."""
    turn: NDArray | None
    """By a turn of the marker's frame in W, its origin kept. Shape (N, k, 3)."""
    p_WM: NDArray
    """Markers. Shape (N, 3)."""
    pose: NDArray
    """Samples. Shape (N,)."""
    samples: NDArray | slice
    """Those of all scalars. Shape (N k,)."""

    @cached_property
    def shift_first(self) -> NDArray:
        """`shift` with its components first and scalars last. Shape (3, N k)."""
        return np.ascontiguousarray(self.shift.reshape(-1, 3).T)

    @cached_property
    def turn_first(self) -> NDArray | None:
        """`turn` with its components first and scalars last. Shape (3, N k)."""
        return None if self.turn is None else np.ascontiguousarray(self.turn.reshape(-1, 3).T)

    @cached_property
    def p_first(self) -> NDArray:
        """Markers of all scalars. Shape (3, N k)."""
        return np.repeat(self.p_WM.T, self.shift.shape[1], axis=1)

    @classmethod
    def of_sight(cls, sight: Sight, seen: AttachedEnds) -> "Push":
        """Return it of what sensors show of what is seen."""
        shown, R_SW = sight.shown, sight.R_SW
        turn = None if shown.by_turn is None else shown.by_turn @ R_SW
        return cls(shown.by_point @ R_SW, turn, sight.p_WM, seen.pose, seen.scalar_samples)

    def of(self, rows: NDArray, origins: NDArray) -> tuple[NDArray, NDArray]:
        """Return derivatives by turns about frames' origins (3, S), and by shifts. (M, k, 3)."""
        about = self.turn_of(rows, origins[:, self.pose[rows]].T)
        assert about is not None
        return about, self.shift[rows]

    def turn_of(self, rows: NDArray, origin: NDArray | None) -> NDArray | None:
        """Return derivatives by turns about points; None where nothing depends on them.

        w x (p - o) = -[p - o] w; about the marker itself (no origin) only its frame turns.
        """
        if origin is None:
            return None if self.turn is None else self.turn[rows]
        about = -self.shift[rows] @ skew(self.p_WM[rows] - origin)
        return about if self.turn is None else about + self.turn[rows]


def by_frames(
    motion: TreeMotion,
    bases: tuple[NDArray, NDArray],
    push: Push,
    signs: NDArray,
    J: NDArray,
    by_q: NDArray,
    which: NDArray,
) -> None:
    """Add what turns and shifts of joint frames move, and displacements: all joints at once.

    Arrays have the components of vectors first and scalars last, (3, joints, N k).

    Args:
        bases: `TreeParameters.turn_slopes` and `TreeParameters.frames`.
        push: What turns and shifts in W do.
        signs: Whether each joint moves each row, and which way. Shape (N, n).
        J: By all parameters. Shape (P, N, k).
        by_q: By displacements. Shape (n, N, k).
        which: Joints that have frames. Boolean, shape (n,).
    """
    if not which.any():
        return
    joints = consecutive(np.flatnonzero(which))
    sign = np.repeat(signs.T[joints], push.shift.shape[1], axis=1)
    both = np.empty((3, 2, *sign.shape))
    about, along = both[:, 0], both[:, 1]
    np.multiply(push.shift_first[:, None], sign, out=along)
    p_WJ = at_samples(motion.p_WJ[joints].swapaxes(0, 1), push.samples)
    about[:] = cross(push.p_first[:, None] - p_WJ, along)
    if push.turn_first is not None:
        about += push.turn_first[:, None] * sign
    R = at_samples(motion.R_WP[joints].transpose(1, 2, 0, 3), push.samples)
    # (R base)' of what moves in W is what the parts of frames move.
    on_link = dot_first(both[:, None], R[:, :, None]).transpose(1, 2, 0, 3)
    told = np.stack([bases[0][joints], bases[1][joints, :3, :3]]).swapaxes(2, 3) @ on_link
    count = len(which)
    J[: 6 * count].reshape(count, 2, 3, -1)[joints] += told.swapaxes(0, 1)
    z = at_samples(motion.R_WJ[joints, :, 2].swapaxes(0, 1), push.samples)
    motions = np.array(motion.tree.motions)[joints]
    for kind, by in ((REVOLUTE, about), (PRISMATIC, along)):
        if (own := motions == kind).any():
            moved = dot_first(by, z) if own.all() else dot_first(by, z) * own[:, None]
            by_q.reshape(count, -1)[joints] += moved


def by_bearing(i: int, motion: TreeMotion, push: "Push", moved: NDArray) -> NDArray:
    """Return what turns of a bearing across its axis, about its own place, and shifts move.

    About x and y, then along them. Shape (4, M, k).
    """
    assert motion.tree.bending is not None
    R, pivot = motion.R_WJ[i], motion.tree.bending.pivots[i]
    about, along = push.of(moved, motion.p_WJ[i] + pivot * R[:, 2])
    turns = np.moveaxis(R[:, :2][:, :, push.pose[moved]], 2, 0)
    return np.moveaxis(np.concatenate([about @ turns, along @ turns], axis=2), 2, 0)


def by_bends(motion: TreeMotion, read: NDArray, across: NDArray, pose: NDArray) -> NDArray:
    """Return what bends moves of one sensor's rows.

    Args:
        motion: The body where it bends.
        read: Derivatives of the residuals by what is read. Shape (n, N, k).
        across: Those by turns of bearings about x and y, and by shifts. Shape (4, n, N, k).
        pose: Samples of the rows. Shape (N,).

    Returns:
        Shape (K, N, k).
    """
    tree, load = motion.tree, motion.load
    assert tree.bending is not None
    assert load is not None
    turns = np.array([motion == REVOLUTE for motion in tree.motions], dtype=float)
    by_turn, x, y, *shifts = (
        np.moveaxis(by, 2, 0) for by in (read * turns[:, None, None], *across)
    )
    frames = load.before[:, pose], load.after[:, pose], load.moments[:, pose]
    at = Bent(
        *(load.q[pose], load.approach[pose], *frames, by_turn, (x, y), (shifts[0], shifts[1])),
        carries=carries(motion.tree),
        drives=tree.coupling,
    )
    return bending_slopes(tree.bending, at).transpose(2, 1, 0)
