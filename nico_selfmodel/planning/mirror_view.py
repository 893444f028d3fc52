"""What a robot can see of its hand in a mirror, by its description.

Where the glass has to be, and which poses turn the marker to it with nothing in between.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.errors import ModelError
from nico_selfmodel.geometry.transform import apply, inverse, transform
from nico_selfmodel.model.cameras.mirror import Mirror
from nico_selfmodel.model.cameras.mirror_rig import MirrorRig
from nico_selfmodel.planning.visible_workspace import VisibleWorkspace
from nico_selfmodel.systems.rendering.mirror_scene import MirrorPlate

_MARGIN = 60.0
"""Planned reflections stay this far from the images' edges: a true head is degrees off [px]."""
_CLEARANCE = 0.05
"""How far the arm keeps from the glass [m]."""
_EDGE = 0.03
"""How far lines of sight keep from the edges of the glass [m]."""
LEAST_SIDE = 12.5
"""Least width at which a fiducial can be read in a mirror, seen at its angle [px]."""
_SIDE = {"fiducial": 0.0288}
"""Side of the black square [m]."""
_POOL = 20000
ENOUGH = 500
"""Poses from which to choose."""
_STEPS = 12
"""Points of each stretch of a line of sight at which nothing may be."""
_ROOM = 0.02
"""How far the robot keeps from a line of sight: it is rounder than its collision shapes [m]."""
_OFF = 0.055
"""What is this near to a marker or a camera belongs to it [m]."""


@dataclass(frozen=True, eq=False)
class MirrorView:
    """A mirror before a robot as described; a true one differs by degrees."""

    workspace: VisibleWorkspace
    """The arm before its cameras."""
    mirror: Mirror
    """The mirror, before the left camera as designed."""
    plate: MirrorPlate
    """The glass."""
    X_BM: NDArray
    """Pose of the glass in the frame of the arm's base. Shape (4, 4)."""
    q: NDArray
    """Poses from which to choose: their markers are seen in the glass [rad]. Shape (P, n)."""

    @classmethod
    def of(
        cls,
        workspace: VisibleWorkspace,
        mirror: Mirror,
        plate: MirrorPlate,
        rng: np.random.Generator,
        enough: int = ENOUGH,
    ) -> "MirrorView":
        """Put the middle of the glass where most reflections are seen, and look for poses.

        Args:
            mirror: Where the mirror shall stand before the left camera.
            enough: Poses to look for.

        Raises:
            ModelError: If hardly any pose shows a reflection.
        """
        arm, rig = workspace.arm, MirrorRig(workspace.rig, mirror)
        q = rng.uniform(arm.lower, arm.upper, (_POOL, len(arm.lower)))
        q = q[_shown(workspace, rig, q)]
        if not len(q):
            raise ModelError(_nothing(mirror))
        spots = _spots(workspace, rig, q)
        X_BM = _pose(workspace, mirror, np.median(spots.reshape(-1, 3), axis=0))
        half = 0.5 * np.array([plate.width, plate.height]) - _EDGE
        on_glass = (np.abs(apply(inverse(X_BM), spots)[..., :2]) < half).all(axis=(0, 2))
        q, spots = q[on_glass], spots[:, on_glass]
        usable = []
        for k, pose in enumerate(q):
            if not workspace.body.collides(pose) and _open_sight(workspace, pose, spots[:, k]):
                usable.append(k)
                if len(usable) == enough:
                    break
        if not usable:
            raise ModelError(_nothing(mirror))
        q = q[usable]
        return cls(workspace, mirror, plate, X_BM, q)

    def near(self, q: NDArray, count: int) -> "MirrorView":
        """Return the view with only the poses next to some others.

        Far from the poses that it was learned from an arm may be wrong by more than it knows, which
        looks like a mirror that is not flat.

        Args:
            q: The other poses [rad]. Shape (K, n).
        """
        span = np.maximum(np.ptp(q, axis=0), 1e-9)
        apart = np.abs(self.q[:, None] - q) / span
        nearest = np.argsort(apart.max(axis=2).min(axis=1), kind="stable")[:count]
        return replace(self, q=self.q[np.sort(nearest)])


def _shown(workspace: VisibleWorkspace, rig: MirrorRig, q: NDArray) -> NDArray:
    """Return which poses show all markers in a mirror to both cameras. Shapes (N, n) -> (N,)."""
    shown = np.ones(len(q), dtype=bool)
    for marker in workspace.markers:
        k = workspace.arm.markers.index(marker)
        p_BH = workspace.arm.chain.forward(q, k)
        shown &= rig.rig.inside(rig.project(p_BH), _MARGIN)
        shown &= rig.plane.distance_to(p_BH) > _CLEARANCE
        if marker in _SIDE:
            shown &= _width_in_mirror(workspace, rig, q, k) * _SIDE[marker] > LEAST_SIDE
    return shown


def _width_in_mirror(workspace: VisibleWorkspace, rig: MirrorRig, q: NDArray, k: int) -> NDArray:
    """Return how wide a metre along z of a point's frame looks, at its angle [px]. Shape (N,)."""
    p_BH, normal = workspace.arm.chain.forward(q, k), workspace.normals(q, k)
    widths = []
    for camera in rig.virtual.cameras:
        way = camera.X_WC[:3, 3] - p_BH
        # Focal length over distance, times the cosine at which the marker is seen.
        widths.append(camera.fx * np.sum(way * normal, axis=1) / np.sum(way * way, axis=1))
    return np.min(widths, axis=0)


def _spots(workspace: VisibleWorkspace, rig: MirrorRig, q: NDArray) -> NDArray:
    """Return where lines of sight meet the glass, in the base's frame. Shape (E m, N, 3)."""
    spots = []
    for marker in workspace.markers:
        p_BH = workspace.arm.chain.forward(q, workspace.arm.markers.index(marker))
        centres = [twin.X_WC[:3, 3] for twin in rig.virtual.cameras]
        spots += [rig.plane.met_between(center, p_BH) for center in centres]
    return np.array(spots)


def _open_sight(workspace: VisibleWorkspace, q: NDArray, spots: NDArray) -> bool:
    """Return whether nothing of the robot stands between its markers, the glass and its cameras.

    Args:
        q: A pose [rad]. Shape (n,).
        spots: Where lines of sight meet the glass, by marker, then camera. Shape (2 m, 3).
    """
    steps, points = np.linspace(0.0, 1.0, _STEPS)[:, None], []
    for k, marker in enumerate(workspace.markers):
        p_BH = workspace.arm.chain.forward(q, workspace.arm.markers.index(marker))
        for camera, spot in zip(workspace.rig.cameras, spots[2 * k : 2 * k + 2], strict=True):
            for end in (p_BH, camera.X_WC[:3, 3]):
                way = spot - end
                points.append(end + _OFF * way / np.linalg.norm(way) + steps * (spot - end))
    return not workspace.body.covers(q, np.concatenate(points), _ROOM)


def _pose(workspace: VisibleWorkspace, mirror: Mirror, middle: NDArray) -> NDArray:
    """Return the pose of a glass about a point of it, upright to the left camera. Shape (4, 4)."""
    X_BL = workspace.rig.left.X_WC
    into = -X_BL[:3, :3] @ mirror.normal
    right = np.cross(X_BL[:3, 1], into)
    right = right / np.linalg.norm(right)
    return transform(np.stack([right, np.cross(into, right), into], axis=1), middle)


def _nothing(mirror: Mirror) -> str:
    tilt_x, tilt_y = np.degrees(mirror.values[:2])
    return (
        f"hardly any pose shows the hand in a mirror {1e3 * mirror.distance:.0f} mm before the "
        f"left camera, tilted by {tilt_x:.0f} and {tilt_y:.0f} deg: put it elsewhere; 300 mm, 0 "
        "and -20 deg is a good place"
    )
