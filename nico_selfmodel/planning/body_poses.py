"""Poses of a whole body in which its own cameras see enough: a room about it, or its own hands."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.geometry.transform import inverse, transform
from nico_selfmodel.model.tree.body_tree import Attached, BodyTree
from nico_selfmodel.model.tree.tree_motion import TreeMotion
from nico_selfmodel.plant.body_description import BodyDescription

_DRAWN = 2000
"""Poses that are drawn at once."""
_ROUNDS = 40
"""How often they are drawn before it is given up."""
_EDGE_PX = 20.0
"""A marker nearer to an image's edge may be out of it in a body that is not as described [px]."""


@dataclass(frozen=True, eq=False)
class BodyView:
    """A body as described, and where markers about it are thought to be."""

    body: BodyDescription
    """The body; what it commands moves, the rest is held."""
    room: Sequence[Attached] = ()
    """Markers fixed in the room, in the frame of the root link."""

    @property
    def tree(self) -> BodyTree:
        """The nominal body with the room about it."""
        return self.body.tree.with_markers((*self.body.tree.markers, *self.room))

    def seen(self, q: NDArray) -> NDArray:
        """Return which cameras would see which markers, but for what hides them.

        Args:
            q: Angles of the commanded joints [rad]. Shape (N, k).

        Returns:
            Boolean, shape (N, cameras, markers).
        """
        tree = self.tree
        everything = np.array([[self.body.held.get(name, 0.0) for name in tree.joints]])
        everything = np.repeat(everything, len(q), axis=0)
        everything[:, self.body.columns] = q
        motion = TreeMotion.at(tree, everything)
        p_WM = np.stack([motion.pose_of(m)[1].T for m in tree.markers], axis=1)
        out = np.zeros((len(q), len(tree.sensors), len(tree.markers)), dtype=bool)
        for c, sensor in enumerate(tree.sensors):
            R, p = motion.pose_of(sensor)
            X_CW = inverse(transform(R.transpose(2, 0, 1), p.T))
            p_CM = np.einsum("nij,nmj->nmi", X_CW[:, :3, :3], p_WM) + X_CW[:, None, :3, 3]
            lens = tree.lenses[sensor.name].at(np.eye(4))
            uv = lens.project(p_CM.reshape(-1, 3)).reshape(*p_CM.shape[:2], 2)
            far = np.array(lens.image_size) - 1.0 - _EDGE_PX
            with np.errstate(invalid="ignore"):
                out[:, c] = ((uv > _EDGE_PX) & (uv < far)).all(axis=2)
        return out

    def poses(
        self, markers: Sequence[str], fewest: int, count: int, rng: np.random.Generator,
        also: tuple[Sequence[str], int] = ((), 0),
    ) -> NDArray:  # fmt: skip
        """Draw poses in which every camera sees enough of some markers.

        Args:
            markers: Their names.
            fewest: How many of them each camera shall see.
            count: How many poses.
            rng: Source of the draws.
            also: More markers, and how many of those each camera shall see too.

        Returns:
            Angles of the commanded joints [rad]. Shape (count, k).

        Raises:
            ValueError: If hardly any pose shows them.
        """
        names = [marker.name for marker in self.tree.markers]
        wanted = [([names.index(name) for name in markers], fewest)]
        wanted += [([names.index(name) for name in also[0]], also[1])] if also[1] else []
        found: list[NDArray] = []
        for _ in range(_ROUNDS):
            q = rng.uniform(self.body.lower, self.body.upper, (_DRAWN, len(self.body.joints)))
            seen = self.seen(q)
            good = np.all([seen[:, :, own].sum(axis=2) >= n for own, n in wanted], axis=(0, 2))
            found.extend(q[good])
            if len(found) >= count:
                return np.array(found[:count])
        raise ValueError(
            f"{len(found)} of {_ROUNDS * _DRAWN} poses show every camera {fewest} of the markers, "
            f"{count} are wanted: put the markers before the head, or ask for fewer"
        )
