"""Forward kinematics of a body: where links, markers and sensors are at many poses.

Arrays hold the pose last, (..., N), so that every operation runs along contiguous memory.
"""

from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.geometry.transform import transform
from nico_selfmodel.model.tree.body_tree import REVOLUTE, WHOLE_POSES, Attached, BodyTree
from nico_selfmodel.model.tree.tree_load import TreeLoad


@dataclass(frozen=True, eq=False)
class TreeMotion:
    """Poses of joint frames and links in W at N poses of a body."""

    tree: BodyTree
    """The body."""
    q: NDArray
    """Displacements of all joints [rad or m]. Shape (n, N)."""
    R_WP: NDArray
    """Orientations of the links that carry each joint. Shape (n, 3, 3, N)."""
    R_WJ: NDArray
    """Orientations of the joint frames before they move. Shape (n, 3, 3, N)."""
    p_WJ: NDArray
    """Origins of the joint frames [m]. Shape (n, 3, N)."""
    R_WL: NDArray
    """Orientations of the links; the last is the world's. Shape (n + 1, 3, 3, N)."""
    p_WL: NDArray
    """Origins of the links [m]; the last is the world's. Shape (n + 1, 3, N)."""

    load: TreeLoad | None = None
    """Of a body that bends."""

    @classmethod
    def at(
        cls,
        tree: BodyTree,
        readings: NDArray,
        flanges: NDArray | None = None,
        approach: NDArray | None = None,
    ) -> "TreeMotion":
        """Move a body.

        Args:
            readings: Encoder angles [rad] or lengths [m], floats or Drake's scalars. Shape (N, n).
            flanges: Whole poses by joint; used where a joint is a flange or free.
                Shape (N, n, 4, 4).
            approach: How each reading last moved, -1, 1, or 0 where it is not known, as all are if
                omitted. Shape (N, n).

        Returns:
            Where everything is.
        """
        rigid = cls._moved(tree, tree.displacements(readings), flanges, None)
        if tree.bending is None:
            return rigid
        load = TreeLoad.of(tree, tree.bending, rigid.R_WJ, rigid.R_WL[:-1], readings, approach)
        q = (load.q + tree.bending.turns(load.q, load.moments, load.approach)) @ tree.coupling.T
        moved = cls._moved(tree, q, flanges, load.bearings)
        return replace(moved, load=load)

    @classmethod
    def _moved(
        cls, tree: BodyTree, q: NDArray, flanges: NDArray | None, bearings: NDArray | None
    ) -> "TreeMotion":
        """Move joints by displacements (N, n), after their bearings turned them. (n, N, 4, 4)."""
        n, count = len(tree.joints), len(q)
        q = np.ascontiguousarray(q.T)
        R_WP, R_WJ = (np.empty((n, 3, 3, count), q.dtype) for _ in range(2))
        p_WJ = np.empty((n, 3, count), q.dtype)
        R_WL, p_WL = np.empty((n + 1, 3, 3, count), q.dtype), np.empty((n + 1, 3, count), q.dtype)
        R_WL[n], p_WL[n] = np.eye(3)[:, :, None], 0.0
        for i, (motion, parent) in enumerate(zip(tree.motions, tree.parent.tolist(), strict=True)):
            R_WP[i] = R_WL[parent]
            turned = tree.X_PJ[i, :3].T @ R_WL[parent]
            R_WJ[i], p_WJ[i] = turned[:, :3], p_WL[parent] + turned[:, 3]
            if bearings is not None:
                p_WJ[i] += np.einsum("ijn,nj->in", R_WJ[i], bearings[i, :, :3, 3])
                R_WJ[i] = np.einsum("ijn,njk->ikn", R_WJ[i], bearings[i, :, :3, :3])
            R_WL[i], p_WL[i] = R_WJ[i], p_WJ[i]
            if motion == REVOLUTE:
                c, s = np.cos(q[i]), np.sin(q[i])
                R_WL[i, :, 0] = R_WJ[i, :, 0] * c + R_WJ[i, :, 1] * s
                R_WL[i, :, 1] = R_WJ[i, :, 1] * c - R_WJ[i, :, 0] * s
            elif motion in WHOLE_POSES:
                assert flanges is not None
                read = np.moveaxis(flanges[:, i], 0, -1)
                R_WL[i] = np.einsum("ijn,jkn->ikn", R_WJ[i], read[:3, :3])
                p_WL[i] = p_WJ[i] + np.einsum("ijn,jn->in", R_WJ[i], read[:3, 3])
            else:
                p_WL[i] = p_WJ[i] + R_WJ[i, :, 2] * q[i]
        return cls(tree, q, R_WP, R_WJ, p_WJ, R_WL, p_WL)

    def pose_of(self, item: Attached) -> tuple[NDArray, NDArray]:
        """Return orientation and position of what is fixed to a link. (3, 3, N) and (3, N)."""
        R = np.einsum("ijn,jk->ikn", self.R_WL[item.on], item.X_LA[:3, :3])
        return R, self.p_WL[item.on] + _turn(self.R_WL[item.on], item.X_LA[:3, 3])

    def poses(self, item: Attached) -> NDArray:
        """Return the poses of what is fixed to a link [m]. Shape (N, 4, 4)."""
        R, p = self.pose_of(item)
        return transform(R.transpose(2, 0, 1), p.T)

    def places(self, items: Iterable[Attached]) -> NDArray:
        """Return where what is fixed to links is [m]. Shape (N, items, 3)."""
        return np.stack([self.pose_of(item)[1].T for item in items], axis=1)

    def points(self, marker: NDArray, pose: NDArray) -> NDArray:
        """Return where markers are in W, one a row.

        Args:
            marker: Index of each row's marker. Shape (M,).
            pose: Index of each row's pose. Shape (M,).

        Returns:
            Shape (M, 3).
        """
        on = np.array([m.on for m in self.tree.markers])[marker]
        at = np.stack([m.X_LA[:3, 3] for m in self.tree.markers])[marker]
        R = self.R_WL[on, :, :, pose]
        return np.asarray(self.p_WL[on, :, pose] + (R @ at[:, :, None])[:, :, 0])

    def points_from(self, link: int, marker: NDArray, pose: NDArray) -> NDArray:
        """Return where markers are in a link's frame, one a row.

        Args:
            link: Index of the link.
            marker: Index of each row's marker. Shape (M,).
            pose: Index of each row's pose. Shape (M,).

        Returns:
            Shape (M, 3).
        """
        R = self.R_WL[link][:, :, pose].transpose(2, 1, 0)
        away = self.points(marker, pose) - self.p_WL[link][:, pose].T
        return np.asarray((R @ away[:, :, None])[:, :, 0])


def _turn(R: NDArray, v: NDArray) -> NDArray:
    """Return R v of all poses. Shapes (3, 3, N) and (3,) -> (3, N)."""
    return np.einsum("ijn,j->in", R, v)
