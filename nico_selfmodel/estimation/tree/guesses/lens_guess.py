"""Lenses that neither a recording nor boards tell, from markers whose places are nearly known.

A described robot, a tracker that sees the same markers, or markers of known place in the room tell
a camera's place for any focal length (resection), or where a camera moves that of each sample; the
focal length is that at which most of them appear where they were seen.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.dataset.body.body_dataset import BodyDataset
from nico_selfmodel.dataset.body.sensors import CAMERA, POINTS, POSES
from nico_selfmodel.errors import DataError
from nico_selfmodel.estimation.tree.guesses.camera_guess import together
from nico_selfmodel.estimation.tree.guesses.carried_cameras import pose_before
from nico_selfmodel.estimation.tree.tree_observations import SensorRows, TreeObservations
from nico_selfmodel.estimation.tree.tree_setup import Description
from nico_selfmodel.geometry.resection import FEWEST, robust_camera_pose
from nico_selfmodel.geometry.transform import inverse, transform
from nico_selfmodel.model.cameras.camera import Camera
from nico_selfmodel.model.tree.body_tree import WORLD, WORLD_NAME
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
_VIEWS = 10
"""Samples by which the focal length of a camera that moves is told: those that show most."""
View = tuple[NDArray, NDArray]
"""Markers that a camera saw from one place, nearly, and their pixels. Shapes (N, 3), (N, 2)."""


def guessed_lenses(
    data: BodyDataset, known: Mapping[str, Camera], description: Description | None, seed: int
) -> dict[str, Camera]:
    """Return pinholes for cameras of which no lens is known, to be learned with all else.

    Args:
        known: Intrinsics of other cameras, by name, beside those that it tells.
        description: The robot as described, where it is.

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
        views = [v for rows in seen if not rows.mirror for v in _views(data, rows, description)]
        if sum(len(p) for p, _ in views) < _FEWEST:
            others = (
                "a robot description, a tracker that sees the same markers, or markers at known "
                "places tell it, too"
            )
            if info.on != WORLD_NAME:
                others = (
                    "a robot description, or six markers or more at known places in a sample, tell "
                    "that of a camera that moves, too"
                )
            raise DataError(
                f"nothing tells the lens of camera {info.name!r}: put 'lens' into dataset.yaml, "
                f"give calibrated cameras, or record boards; {others}"
            )
        found[info.name] = _likeliest(views, info.image_size, np.random.default_rng((seed, s)))
    return found


def _views(data: BodyDataset, rows: SensorRows, description: Description | None) -> list[View]:
    """Return what a camera saw of markers at nearly known places, from its link or each sample."""
    info = data.sensors[rows.sensor]
    if description is not None:
        tree = description.tree
        motion = TreeMotion.at(tree, data.si_readings, data.X_flange)
        on = data.on_link(info.on)
        R = motion.R_WL[on][:, :, rows.pose].transpose(2, 0, 1)
        X_LW = inverse(transform(R, motion.p_WL[on][:, rows.pose].T))
        p = motion.points(rows.marker, rows.pose)
        return [((X_LW[:, :3, :3] @ p[:, :, None])[:, :, 0] + X_LW[:, :3, 3], rows.measured)]
    trackers = [
        one
        for one in TreeObservations.of(data).sensors
        if one.kind in (POINTS, POSES) and data.sensors[one.sensor].on == WORLD_NAME
    ]
    if trackers and info.on == WORLD_NAME:
        i, j = together(rows, trackers[0])
        return [(trackers[0].measured[j, :3], rows.measured[i])]
    known = np.array([m.xyz is not None for m in data.markers])[rows.marker]
    p = np.array([m.xyz or (0.0, 0.0, 0.0) for m in data.markers])[rows.marker]
    on = np.array([data.on_link(m.on) for m in data.markers])[rows.marker]
    if info.on == WORLD_NAME and (known & (on == WORLD)).any():
        samples = [np.flatnonzero(known & (on == WORLD))]
    else:
        samples = _by_sample(np.flatnonzero(known), rows.pose * (len(data.joints) + 1) + on)
    return [(p[own], rows.measured[own]) for own in samples]


def _by_sample(rows: NDArray, view: NDArray) -> list[NDArray]:
    """Return rows by sample and link, of those that tell a pose, those with most of them."""
    rows = rows[np.argsort(view[rows], kind="stable")]
    each = np.split(rows, np.flatnonzero(np.diff(view[rows])) + 1)
    each.sort(key=len, reverse=True)
    return [own for own in each if len(own) >= FEWEST][:_VIEWS]


def _likeliest(views: Sequence[View], size: tuple[int, int], rng: np.random.Generator) -> Camera:
    """Return the pinhole behind which points appear best where they were seen."""
    width, height = size
    lenses = [
        Camera(length, length, 0.5 * width, 0.5 * height, size)
        for length in (_LENGTHS * width).tolist()
    ]
    alone = len(views) == 1
    missed = [
        float(np.median(np.concatenate([_missed(lens, view, rng, alone) for view in views])))
        for lens in lenses
    ]
    return lenses[int(np.argmin(missed))]


def _missed(lens: Camera, view: View, rng: np.random.Generator, alone: bool) -> NDArray:
    """Return how far points would appear from where they were seen [px]. Shape (N,)."""
    p, pixels = view
    rays = lens.directions(pixels)
    if alone:
        within = min(_WITHIN * lens.image_size[0] / lens.fx, _WITHIN)
        X, _ = robust_camera_pose(p, rays, within, rng, _DRAWS)
    else:
        X, _ = pose_before(p, rays, rng)
    there = replace(lens, X_WC=X).project(p)
    return np.linalg.norm(np.nan_to_num(there, nan=np.inf) - pixels, axis=1)
