"""Lenses that neither a recording nor boards tell, from markers whose places are nearly known.

A described robot, a tracker that sees the same markers, or markers of known place in the room tell
a camera's place for any focal length (resection); the focal length is that at which most of them
appear where they were seen.
"""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.dataset.body.body_dataset import BodyDataset
from nico_selfmodel.dataset.body.link_joint import WORLD_NAME
from nico_selfmodel.dataset.body.sensors import CAMERA, POINTS, POSES
from nico_selfmodel.errors import DataError
from nico_selfmodel.estimation.tree.guesses.camera_guess import together
from nico_selfmodel.estimation.tree.tree_observations import SensorRows, TreeObservations
from nico_selfmodel.estimation.tree.tree_setup import Description
from nico_selfmodel.geometry.resection import robust_camera_pose
from nico_selfmodel.geometry.transform import inverse, transform
from nico_selfmodel.model.cameras.camera import Camera
from nico_selfmodel.model.tree.tree_motion import TreeMotion

PARTS = ("fx", "fy", "cx", "cy", "k1", "k2", "p1", "p2")
"""What is learned of such a lens."""
FACTORS = (1.0, 0.75, 1.35)
"""Of the focal length that a guess is tried with."""
_LENGTHS = np.geomspace(0.5, 6.0, 16)
"""Focal lengths that are tried, in widths of the image."""
_FEWEST = 12
"""Markers at places that are nearly known below which nothing is told."""
_WITHIN = 0.05
"""Part of the focal length within which a described marker must appear where it is expected."""
_DRAWS = 60


def guessed_lenses(
    data: BodyDataset, known: Mapping[str, Camera], description: Description | None, seed: int
) -> dict[str, Camera]:
    """Return pinholes for cameras of which no lens is known, to be learned with all else.

    Args:
        data: The recording.
        known: Intrinsics of other cameras, by name, beside those that it tells.
        description: The robot as described, where it is.
        seed: Of what is drawn.

    Raises:
        DataError: If nothing tells such a lens, or the camera has no image size.
    """
    found = {}
    for s, info in enumerate(data.sensors):
        if info.kind != CAMERA or info.camera is not None or info.name in known:
            continue
        if info.image_size is None:
            raise DataError(f"camera {info.name!r} has no 'image_size' in dataset.yaml")
        seen = [rows for rows in TreeObservations.of(data).sensors if rows.sensor == s]
        places = [_places(data, rows, description) for rows in seen if not rows.mirror]
        p = np.concatenate([np.zeros((0, 3)), *(place for place, _ in places)])
        pixels = np.concatenate([np.zeros((0, 2)), *(pixel for _, pixel in places)])
        if len(p) < _FEWEST:
            others = "a robot description tells that of a camera that moves, too"
            if info.on == WORLD_NAME:
                others = (
                    "a robot description, a tracker that sees the same markers, or markers at "
                    "known places tell it, too"
                )
            raise DataError(
                f"nothing tells the lens of camera {info.name!r}: put 'lens' into dataset.yaml, "
                f"give calibrated cameras, or record boards; {others}"
            )
        found[info.name] = _likeliest(p, pixels, info.image_size, np.random.default_rng((seed, s)))
    return found


def _places(
    data: BodyDataset, rows: SensorRows, description: Description | None
) -> tuple[NDArray, NDArray]:
    """Return markers in the frame of a camera's link, nearly, and their pixels. (N, 3), (N, 2)."""
    info = data.sensors[rows.sensor]
    if description is not None:
        tree = description.tree
        motion = TreeMotion.at(tree, data.si_readings, data.X_flange)
        on = data.on_link(info.on)
        R = motion.R_WL[on][:, :, rows.pose].transpose(2, 0, 1)
        X_LW = inverse(transform(R, motion.p_WL[on][:, rows.pose].T))
        p = motion.points(rows.marker, rows.pose)
        return (X_LW[:, :3, :3] @ p[:, :, None])[:, :, 0] + X_LW[:, :3, 3], rows.measured
    if info.on != WORLD_NAME:
        return np.zeros((0, 3)), np.zeros((0, 2))
    trackers = [
        one
        for one in TreeObservations.of(data).sensors
        if one.kind in (POINTS, POSES) and data.sensors[one.sensor].on == WORLD_NAME
    ]
    if trackers:
        i, j = together(rows, trackers[0])
        return trackers[0].measured[j, :3], rows.measured[i]
    known = np.array([m.xyz is not None and m.on == WORLD_NAME for m in data.markers])
    own = known[rows.marker]
    xyz = np.array([m.xyz or (0.0, 0.0, 0.0) for m in data.markers])
    return xyz[rows.marker[own]], rows.measured[own]


def _likeliest(
    p: NDArray, pixels: NDArray, size: tuple[int, int], rng: np.random.Generator
) -> Camera:
    """Return the pinhole behind which points appear best where they were seen."""
    width, height = size
    least, best = np.inf, None
    for length in (_LENGTHS * width).tolist():
        lens = Camera(length, length, 0.5 * width, 0.5 * height, size)
        rays = lens.directions(pixels)
        within = min(_WITHIN * width / length, _WITHIN)
        X, _ = robust_camera_pose(p, rays, within, rng, _DRAWS)
        there = replace(lens, X_WC=X).project(p)
        off = np.linalg.norm(np.nan_to_num(there, nan=np.inf) - pixels, axis=1)
        cost = float(np.median(off))
        if cost < least:
            least, best = cost, lens
    assert best is not None
    return best
