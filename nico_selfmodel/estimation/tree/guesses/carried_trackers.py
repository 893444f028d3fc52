"""Trackers that links carry, of markers whose places nobody knows."""

from contextlib import suppress
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.dataset.body.body_dataset import BodyDataset
from nico_selfmodel.dataset.body.sensors import POSES
from nico_selfmodel.errors import DataError
from nico_selfmodel.estimation.tree.guesses.by_first_body import (
    with_orientations,
    with_sensors,
    with_tracker,
)
from nico_selfmodel.estimation.tree.guesses.carried_cameras import PlacedCamera, body_by_carried
from nico_selfmodel.estimation.tree.guesses.flange_guess import with_markers_seen_by
from nico_selfmodel.estimation.tree.guesses.hand_eye import HandEye
from nico_selfmodel.estimation.tree.tree_observations import SensorRows, TreeObservations
from nico_selfmodel.estimation.tree.tree_setup import standing_tag
from nico_selfmodel.geometry.rotation import rotation_from_vector
from nico_selfmodel.geometry.transform import inverse, transform
from nico_selfmodel.model.tree.body_tree import WORLD_NAME, Attached, BodyTree
from nico_selfmodel.model.tree.tree_motion import TreeMotion


def with_carried_tracker(data: BodyDataset, tree: BodyTree, rows: SensorRows) -> BodyTree | None:
    """Return a body with a tracker where it is on its link, by how what it sees moves.

    Nobody needs to know where markers are. By whole poses it is a hand-eye calibration, F X = Z M
    with F the marker's link in the tracker's.

    Returns:
        None where it stands, or sees markers of known place: places tell it better; or where links
        hardly turn.
    """
    info = data.sensors[rows.sensor]
    m = int(np.bincount(rows.marker).argmax())
    if info.on == WORLD_NAME or data.markers[m].xyz is not None:
        return None
    with suppress(DataError):
        if rows.kind != POSES:
            found = with_tracker(data, tree, rows)
        else:
            placed = with_sensors(tree, {rows.name: _by_turns(data, tree, rows, m)})
            found = with_markers_seen_by(data, placed, rows)
        every = zip(data.markers, tree.markers, found.markers, strict=True)
        return found.with_markers(
            tuple(new if one.xyz is None else told for one, told, new in every)
        )
    return None


def body_from_carried_poses(
    data: BodyDataset, blank: BodyTree, observations: TreeObservations, seed: int
) -> BodyTree | None:
    """Return a body from nothing by a sensor that it carries, of poses of what stands.

    The tag that stands for the world sees the sensor as the sensor sees it: X_WS = M^-1.

    Args:
        blank: The body with nothing known of its geometry.

    Returns:
        None where no sensor tells poses of that tag.

    Raises:
        DataError: If these are too few for the joints.
    """
    name = standing_tag(data)
    for rows in observations.sensors:
        own = rows.kind == POSES and rows.marker == (
            -1 if name is None else blank.marker_index(name)
        )
        if not np.any(own):
            continue
        M = transform(rotation_from_vector(rows.measured[own, 3:]), rows.measured[own, :3])
        placed = PlacedCamera(rows, dict(zip(rows.pose[own].tolist(), inverse(M), strict=True)))
        tree = with_markers_seen_by(data, body_by_carried(data, blank, [placed], [], seed), rows)
        at_world = [replace(m, X_LA=np.eye(4)) if m.name == name else m for m in tree.markers]
        return with_orientations(data, tree.with_markers(tuple(at_world)), observations)
    return None


def _by_turns(data: BodyDataset, tree: BodyTree, rows: SensorRows, m: int) -> NDArray:
    """Return where a sensor of poses is on its link by those of one marker. Shape (4, 4)."""
    info, motion = data.sensors[rows.sensor], TreeMotion.at(tree, data.si_readings, data.X_flange)
    pose, vectors = rows.pose[rows.marker == m], rows.measured[rows.marker == m]
    carrier, marked = (
        motion.poses(Attached("", link)) for link in (data.on_link(info.on), tree.markers[m].on)
    )
    M = transform(rotation_from_vector(vectors[:, 3:]), vectors[:, :3])
    return HandEye.from_poses(inverse(carrier[pose]) @ marked[pose], M).Z
