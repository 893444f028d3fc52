"""Boards that are held before cameras and mirrors: truth for tests of what moves freely."""

from dataclasses import dataclass

import numpy as np

from nico_selfmodel.dataset.body.body_dataset import BodyDataset, ObservationTable
from nico_selfmodel.dataset.body.link_joint import LinkJoint
from nico_selfmodel.dataset.body.sensors import MarkerInfo, SensorInfo
from nico_selfmodel.geometry.alignment import Alignment
from nico_selfmodel.geometry.plane import Plane
from nico_selfmodel.geometry.reflection import reflect
from nico_selfmodel.geometry.rotation import rotation_from_vector
from nico_selfmodel.geometry.transform import apply, transform
from nico_selfmodel.model.cameras.camera import Camera
from nico_selfmodel.model.tree.tree_motion import TreeMotion

LENS = Camera(800.0, 796.0, 645.0, 472.0, (1280, 960), k1=-0.08)


def grid(columns, rows, pitch):
    """Corners of a flat board about its middle. Shape (C, 3)."""
    at = np.stack(np.meshgrid(np.arange(columns), np.arange(rows)), axis=-1).reshape(-1, 2)
    return pitch * np.column_stack([at - at.mean(axis=0), np.zeros(len(at))])


CORNERS, FEW_CORNERS = grid(11, 8, 0.02), grid(7, 5, 0.035)


@dataclass(frozen=True)
class Held:
    """A recording, and where everything was."""

    data: BodyDataset
    X_WB: np.ndarray
    """Poses of the board. Shape (V, 4, 4)."""
    planes: tuple[Plane, ...]
    """Glasses of m0, m1, ..."""
    cameras: tuple[Camera, ...]
    """camera0, camera1, ..."""


def recorded(corners, pixels, mirrors, size, lenses=(), cameras=("camera0",)):
    """Return a recording of one board.

    Args:
        corners: Shape (C, 3).
        pixels: nan where not seen. Shape (V, cameras, 1 + mirrors, C, 2).
        mirrors: Names.
        size: Of the images.
        lenses: Known ones, in the cameras' order; none if empty.
        cameras: Names.
    """
    v, c, w, k = np.nonzero(np.isfinite(pixels).all(axis=4))
    values = np.full((len(v), 6), np.nan)
    values[:, :2] = pixels[v, c, w, k]
    seen = np.array(["", *mirrors])[w]
    table = ObservationTable(v, c, k, np.full(len(v), -1), values, seen)
    known = [dict(lens.named_values) for lens in lenses] or [None] * len(cameras)
    return BodyDataset(
        "boards",
        (LinkJoint("board", motion="free", encoder_unit="pose"),),
        tuple(MarkerInfo(f"c{i}", "board", tuple(p)) for i, p in enumerate(corners.tolist())),
        tuple(
            SensorInfo(name, "camera", image_size=size, lens=lens)
            for name, lens in zip(cameras, known, strict=True)
        ),
        np.arange(len(pixels)),
        np.full((len(pixels), 1), np.nan),
        table,
    )


def pictures(X_WB, planes, cameras, rng, sigma, corners=CORNERS):
    """Return what cameras see of a board, directly and in mirrors; nan where not."""
    out = np.full((len(X_WB), len(cameras), 1 + len(planes), len(corners), 2), np.nan)
    for v, X in enumerate(X_WB):
        p = apply(X, corners)
        for c, camera in enumerate(cameras):
            for w, plane in enumerate((None, *planes)):
                q = p if plane is None else reflect(plane, p)
                if plane is not None and plane.distance_to(p).min() < 0.02:
                    continue
                if (q @ camera.X_WC[:3, 2] - camera.X_WC[:3, 3] @ camera.X_WC[:3, 2]).min() < 0.1:
                    continue
                u = camera.project(q)
                if ((u > 5.0) & (u < np.array(camera.image_size) - 6.0)).all():
                    out[v, c, w] = u + sigma * rng.normal(size=u.shape)
    return out


def behind_the_camera(seed, mirrors, boards=1, sigma=0.3, apart=6.0):
    """Boards beside a camera that sees them in mirrors alone, whose normals point all ways."""
    rng = np.random.default_rng(seed)
    while True:
        turns = rotation_from_vector(rng.normal(0.0, 0.25, (boards, 3)))
        X_WB = transform(turns, rng.uniform([-0.25, -0.15, -0.1], [0.25, 0.15, 0.1], (boards, 3)))
        planes = _glasses(rng, mirrors, X_WB, np.cos(np.radians(apart)))
        if planes is not None:
            break
    names = [f"m{i}" for i in range(mirrors)]
    seen = pictures(X_WB, planes, (LENS,), rng, sigma)
    return Held(recorded(CORNERS, seen, names, LENS.image_size, (LENS,)), X_WB, planes, (LENS,))


def _glasses(rng, count, X_WB, cosine):
    found = []
    for _ in range(3000):
        turn = rotation_from_vector(np.append(rng.uniform(-0.35, 0.35, 2), 0.0))
        plane = Plane(turn @ [0.0, 0.0, -1.0], float(rng.uniform(0.35, 0.8)))
        near = any(plane.normal @ other.normal > cosine for other in found)
        if near or np.isnan(pictures(X_WB, (plane,), (LENS,), rng, 0.0)[:, 0, 1]).any():
            continue
        if len(found) >= 2:
            normals = np.array([*(p.normal for p in found), plane.normal])
            if np.linalg.svd(normals - normals.mean(axis=0))[1][1] < 0.02:
                continue
        found.append(plane)
        if len(found) == count:
            return tuple(found)
    return None


IN_VIEW = ([-0.05, -0.12, 0.5], [0.25, 0.12, 0.8])
"""Least and largest place of a board that both cameras see."""


def before_two_cameras(seed, boards=12, sigma=0.2, mirrors=(), lens=LENS, places=IN_VIEW):
    """Boards before two cameras, and what mirrors show of them."""
    rng = np.random.default_rng(seed)
    turn = rotation_from_vector([0.02, -0.25, 0.01])
    cameras = (lens, lens.at(transform(turn, [0.25, 0.01, 0.03])))
    turns = rotation_from_vector(rng.normal(0.0, 0.4, (boards, 3)))
    X_WB = transform(turns, rng.uniform(*places, (boards, 3)))
    seen = pictures(X_WB, mirrors, cameras, rng, sigma, FEW_CORNERS)
    kept = np.isfinite(seen).any(axis=(1, 2, 3, 4))
    names = [f"m{i}" for i in range(len(mirrors))]
    data = recorded(FEW_CORNERS, seen[kept], names, lens.image_size, cameras=("camera0", "camera1"))
    return Held(data, X_WB[kept], mirrors, cameras)


def shape_mm(learned, true, seed=0):
    """Mean error of markers at 40 poses, the whole turned and shifted to fit.

    How a camera is turned in its own frame is its principal point's, so that the world is.
    """
    q = np.random.default_rng(seed).uniform(-0.9, 0.9, (40, len(true.joints)))
    told, known = (
        np.concatenate([motion.pose_of(marker)[1].T for marker in tree.markers])
        for tree in (learned, true)
        for motion in [TreeMotion.at(tree, q)]
    )
    fit = Alignment.from_points(told, known)
    off = told @ fit.rotation.T + fit.translation - known
    return 1e3 * np.linalg.norm(off, axis=1).mean()
