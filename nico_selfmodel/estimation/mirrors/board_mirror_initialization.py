"""Closed-form starts of a camera and mirrors from boards seen directly and in the mirrors."""

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.dataset.mirrored_boards import MirroredBoards
from nico_selfmodel.errors import DataError, NotIdentifiableError
from nico_selfmodel.estimation.cameras.camera_initialization import board_poses
from nico_selfmodel.estimation.mirrors.mirror_initialization import symmetry_plane
from nico_selfmodel.geometry.homography import homography
from nico_selfmodel.geometry.reflection import reflection
from nico_selfmodel.geometry.transform import apply
from nico_selfmodel.model.cameras.camera import Camera
from nico_selfmodel.model.cameras.mirror import Mirror

_ASIDE = 0.12
"""How far aside of their normals reflections may lie, in sizes of the board, for a rough lens."""
_FLIP = np.diag([-1.0, 1.0, 1.0, 1.0])
"""Turns a board into its mirror image, so that its pose is a proper one."""


def board_mirror_start(
    boards: MirroredBoards, camera: Camera
) -> tuple[tuple[Mirror, ...], NDArray]:
    """Place mirrors and boards before a camera whose lens is known roughly.

    Each board that one photograph shows directly and in a mirror gives pairs of corners that lie
    symmetrically about it. A board that is seen in mirrors alone is placed by reflection.

    Args:
        boards: Corners seen.
        camera: The camera, at the world.

    Returns:
        The mirrors, and X_LG of every board, shape (V, 4, 4).

    Raises:
        DataError: If a mirror stands behind the camera, or is none: reflections of a board are
            mirror images.
        NotIdentifiableError: If no photograph shows the board directly and in a mirror.
    """
    X_LG = _apparent_poses(boards, camera, 0)
    virtual = [_apparent_poses(boards, camera, way + 1) for way in range(len(boards.mirrors))]
    mirrors = tuple(
        _mirror(name, boards, X_LG, behind)
        for name, behind in zip(boards.mirrors, virtual, strict=True)
    )
    for mirror, behind in zip(mirrors, virtual, strict=True):
        missing = np.isnan(X_LG[:, 0, 0]) & np.isfinite(behind[:, 0, 0])
        X_LG[missing] = reflection(mirror.plane) @ behind[missing] @ _FLIP
    return mirrors, X_LG


def _mirror(name: str, boards: MirroredBoards, X_LG: NDArray, behind: NDArray) -> Mirror:
    """Place one mirror between boards and their reflections."""
    both = np.isfinite(X_LG[:, 0, 0]) & np.isfinite(behind[:, 0, 0])
    if not both.any():
        raise NotIdentifiableError(
            f"no photograph shows the board both directly and in mirror {name!r}: one is needed to "
            "tell where the mirror stands"
        )
    corners = apply(X_LG[both][:, None], boards.p_GQ).reshape(-1, 3)
    flipped = boards.p_GQ * np.diag(_FLIP)[:3]
    reflections = apply(behind[both][:, None], flipped).reshape(-1, 3)
    plane = symmetry_plane(corners, reflections)
    gap = reflections - corners
    aside = np.linalg.norm(np.cross(gap, plane.normal), axis=1)
    extent = float(np.linalg.norm(np.ptp(boards.p_GQ, axis=0)))
    if plane.offset <= 0.0 or np.median(aside) > _ASIDE * extent:
        raise DataError(
            f"what is seen in mirror {name!r} is no reflection of the board: corners and "
            "reflections do not lie symmetrically about a plane before the camera; are its corners "
            "listed in the board's own order, and not as they appear?"
        )
    return Mirror.from_plane(plane)


def _apparent_poses(boards: MirroredBoards, camera: Camera, way: int) -> NDArray:
    """Return where boards seem to be, seen one way; mirrored ones as flipped boards. (V, 4, 4)."""
    poses = np.full((len(boards), 4, 4), np.nan)
    plane = boards.p_GQ[:, :2] * (np.diag(_FLIP)[:2] if way else 1.0)
    for view in np.flatnonzero(boards.ways[:, way]):
        seen = boards.seen[view, way]
        ideal = camera.undistort(boards.pixels[view, way][seen])
        poses[view] = board_poses(homography(plane[seen], ideal)[None], 1.0, 1.0)[0]
    return poses
