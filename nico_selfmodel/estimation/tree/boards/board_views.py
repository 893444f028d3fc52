"""Single views of boards: what a camera saw of one in a sample, directly or in a mirror."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.dataset.body.body_dataset import BodyDataset
from nico_selfmodel.dataset.body.sensors import CAMERA
from nico_selfmodel.estimation.tree.boards.board_pose import board_poses_seen
from nico_selfmodel.estimation.tree.tree_observations import BEARING, TreeObservations
from nico_selfmodel.model.cameras.camera import Camera

MIRRORED = np.array([1.0, 1.0, -1.0])
"""Makes a board's corners those of its mirror image, in the frame of that."""


@dataclass(frozen=True, eq=False)
class BoardView:
    """A board as one camera saw it once."""

    sample: int
    joint: int
    """Index of the joint that moves freely, whose link is the board."""
    camera: str
    mirror: str
    """Empty where it was seen directly."""
    X_CB: NDArray
    """The two poses that its corners allow, of the board or of its mirror image. (2, 4, 4)."""
    corners: int
    """How many were seen."""


def board_views(
    observations: TreeObservations, lenses: Mapping[str, Camera]
) -> tuple[BoardView, ...]:
    """Return every view of a board that places it.

    Args:
        lenses: Intrinsics of the cameras, by name.
    """
    return tuple(_views(observations, lenses))


def _views(observations: TreeObservations, lenses: Mapping[str, Camera]) -> Iterator[BoardView]:
    data, places = observations.data, places_on_boards(observations.data)
    for rows in observations.sensors:
        if rows.kind not in (CAMERA, BEARING):
            continue
        camera = rows.name
        seen = rows.measured
        rays = lenses[camera].directions(seen) if rows.kind == CAMERA else seen
        on = data.seen_on[rows.rows]
        for joint in data.free_joints:
            own = np.flatnonzero(on == joint)
            if not len(own):
                continue
            own = own[np.argsort(rows.pose[own], kind="stable")]
            samples, first = np.unique(rows.pose[own], return_index=True)
            for sample, of in zip(samples.tolist(), np.split(own, first[1:]), strict=True):
                p = places[rows.marker[of]] * (MIRRORED if rows.mirror else 1.0)
                found = board_poses_seen(p, rays[of])
                if found is not None:
                    yield BoardView(sample, joint, camera, rows.mirror, np.stack(found), len(of))


def places_on_boards(data: BodyDataset) -> NDArray:
    """Return the known places of markers on their links, nan where not known. Shape (m, 3)."""
    unknown = (np.nan, np.nan, np.nan)
    return np.array([unknown if m.xyz is None else m.xyz for m in data.markers])
