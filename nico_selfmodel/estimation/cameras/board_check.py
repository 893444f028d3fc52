"""Whether cameras measure boards they did not learn from worse than before."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.dataset.board_views import BoardViews
from nico_selfmodel.errors import ModelError
from nico_selfmodel.estimation.cameras.board_accuracy import Reconstruction
from nico_selfmodel.model.cameras.camera import Camera
from nico_selfmodel.model.cameras.stereo_rig import StereoRig

_WORSE_EDGES = 1.1
"""Ratio of the edges' SD beyond which, in most boards, they count as worse."""
_WORSE_SCALE = 2e-3
"""Error of the scale by which it must grow to count as worse."""
_FOREIGN = 0.05
"""Error of the scale before, beyond which these cameras hardly photographed the boards."""


@dataclass(frozen=True, eq=False)
class BoardCheck:
    """Boards rebuilt by cameras before and after they were refined."""

    before: Reconstruction
    """By the cameras that the refinement started from."""
    after: Reconstruction | None
    """By the refined cameras; None where their lens gives no ray for a corner, or no place."""
    held_out: bool
    """Whether the refinement did not use these boards."""

    @classmethod
    def from_rigs(
        cls, before: StereoRig, after: StereoRig, boards: BoardViews, held_out: bool
    ) -> "BoardCheck | None":
        """Rebuild boards with both; None where there is no board to compare them by.

        Boards that were not seen whole by both cameras, or for which the lenses before have no ray
        or no place, tell nothing of what became worse.
        """
        seen = boards.select(boards.seen.all(axis=(1, 2)))
        if not len(seen):
            return None
        rays = [camera.has_rays(p.reshape(-1, 2)) for camera, p in _by_camera(before, seen)]
        compared = seen.select(np.all(rays, axis=0).reshape(len(seen), -1).all(axis=1))
        if not len(compared):
            return None
        earlier = Reconstruction.from_views(before, compared)
        if not earlier.views:
            return None
        again = compared.select(np.isin(compared.names, earlier.views))
        try:
            later = Reconstruction.from_views(after, again)
        except ModelError:
            return cls(earlier, None, held_out)
        return cls(earlier, later if later.views == earlier.views else None, held_out)

    @property
    def reasons(self) -> tuple[str, ...]:
        """Why the refined cameras are refused; empty if they are not."""
        if self.after is None:
            return (
                "the refined lenses fold the image: boards that the cameras saw before have no ray "
                "or no place",
            )
        return tuple(r for r in (self._edge_reason(), self._scale_reason()) if r)

    @property
    def doubt(self) -> str | None:
        """Whether the cameras before, or the squares, are others than those of the photographs."""
        off = float(self.before.scale.mean()) - 1.0
        if abs(off) <= _FOREIGN:
            return None
        return (
            f"the cameras that it began from rebuild {self._boards()} {100 * abs(off):.0f} % too "
            f"{'large' if off > 0.0 else 'small'}: see that they photographed these boards, and "
            "that the side of a square is right"
        )

    def _edge_reason(self) -> str | None:
        assert self.after is not None
        before, after = self.before.edge_sd, self.after.edge_sd
        ratios = _spread_of_each(self.after) / _spread_of_each(self.before)
        if after <= _WORSE_EDGES * before or np.median(ratios) <= 1.0:
            return None
        return (
            f"the SD of the edges of {self._boards()} rose from {1e3 * before:.2f} to "
            f"{1e3 * after:.2f} mm: the refinement bent the cameras to fit the arm"
        )

    def _scale_reason(self) -> str | None:
        assert self.after is not None
        before, after = (abs(float(r.scale.mean()) - 1.0) for r in (self.before, self.after))
        noise = float(self.after.scale.std()) / np.sqrt(len(self.after.scale))
        if after <= before + max(_WORSE_SCALE, 2.0 * noise):
            return None
        now, then = (100.0 * (float(r.scale.mean()) - 1.0) for r in (self.after, self.before))
        return (
            f"{self._boards()} came out {abs(now):.1f} % too {'large' if now > 0.0 else 'small'} "
            f"(before: {abs(then):.1f} %): the refinement lost the scale"
        )

    def _boards(self) -> str:
        return f"{len(self.before.views)} {'held-out ' * self.held_out}boards"


def _by_camera(rig: StereoRig, boards: BoardViews) -> list[tuple[Camera, NDArray]]:
    """Return each camera with the pixels of all corners in it. Shapes (V, P, 2)."""
    return [(rig.left, boards.pixels[:, :, :2]), (rig.right, boards.pixels[:, :, 2:])]


def _spread_of_each(rebuilt: Reconstruction) -> NDArray:
    """Return the SD of each board's edges [m]. Shape (V,)."""
    return rebuilt.edges.reshape(len(rebuilt.views), -1).std(axis=1)
