"""Where in a picture anything can be, from the boxes around all that is drawn."""

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pydrake.geometry import FrameId, GeometryVersion, QueryObject, Role, SceneGraphInspector
from pydrake.math import RigidTransform

CORNERS = np.array([[a, b, c] for a in (-1, 1) for b in (-1, 1) for c in (-1, 1)], dtype=float)
"""Of a cube of two units. Shape (8, 3)."""
_EDGES = np.array([(i, j) for i in range(8) for j in range(i) if (i ^ j) in (1, 2, 4)]).T

Beside = tuple[bytes, int]
"""Pose and label of a box that is partly before and partly behind a camera."""


@dataclass(frozen=True, eq=False)
class _Boxes:
    """Corners of the boxes on one frame."""

    frame: FrameId
    corners: NDArray
    """In the frame. Shape (boxes, 8, 3)."""
    labels: NDArray
    """Of what is in each box, in pictures of labels. Shape (boxes,)."""


@dataclass(frozen=True, eq=False)
class Outline:
    """What boxes tell of one picture."""

    low: NDArray
    """Least X/Z, Y/Z of each box, of what of it is before the camera. Shape (k, 2)."""
    high: NDArray
    """Largest ones. Shape (k, 2)."""
    beside: tuple[Beside, ...]
    """The last ones of these boxes, which are partly behind the camera: what they hold may be
    anywhere within them, or nowhere, like the case of the camera itself."""


@dataclass(eq=False)
class Outlines:
    """The boxes of a scene graph, read anew when something was added to it or taken away."""

    _version: GeometryVersion | None = None
    _boxes: list[_Boxes] = field(default_factory=list)
    _bounded: bool = True

    def before(
        self, query: QueryObject, X_WC: RigidTransform, near: float, far: float
    ) -> Outline | None:
        """Return what boxes tell of a camera's picture.

        Args:
            X_WC: The camera; z is its optical axis.
            near: What is nearer along it is cut off [m].
            far: And what is farther [m].

        Returns:
            The outline; None where something has no box, as a half space.
        """
        self._read(query.inspector())
        if not self._bounded:
            return None
        X_CW, low, high = X_WC.inverse(), [np.zeros((0, 2))], [np.zeros((0, 2))]
        cut, labels = [np.zeros((0, 8, 3))], []
        for boxes in self._boxes:
            X_CF = (X_CW @ query.GetPoseInWorld(boxes.frame)).GetAsMatrix34()
            p = boxes.corners @ X_CF[:, :3].T + X_CF[:, 3]
            first, last = p[:, :, 2].min(axis=1), p[:, :, 2].max(axis=1)
            whole, partly = (first > near) & (first < far), (first <= near) & (last > near)
            rays = p[whole, :, :2] / p[whole, :, 2:]
            low.append(rays.min(axis=1))
            high.append(rays.max(axis=1))
            cut.append(p[partly])
            labels += boxes.labels[partly].tolist()
        corners = np.concatenate(cut)
        for found, bound in zip((low, high), bounds_before(corners, near), strict=True):
            found.append(bound)
        beside = ((np.round(p, 6).tobytes(), k) for p, k in zip(corners, labels, strict=True))
        return Outline(np.concatenate(low), np.concatenate(high), tuple(beside))

    def _read(self, inspector: SceneGraphInspector) -> None:
        version = inspector.geometry_version()
        if self._version is not None and version.IsSameAs(self._version, Role.kPerception):
            return
        found: dict[Any, list[tuple[NDArray, int]]] = {}
        self._bounded = True
        for geometry in inspector.GetAllGeometryIds(Role.kPerception):
            box = inspector.GetObbInGeometryFrame(geometry)
            if box is None:
                self._bounded = False
                return
            X_FB = inspector.GetPoseInFrame(geometry) @ box.pose()
            corners = (X_FB @ (CORNERS * box.half_width()).T).T
            label = inspector.GetPerceptionProperties(geometry).GetProperty("label", "id")
            found.setdefault(inspector.GetFrameId(geometry), []).append((corners, int(label)))
        self._boxes = [
            _Boxes(frame, np.stack([c for c, _ in own]), np.array([label for _, label in own]))
            for frame, own in found.items()
        ]
        # A copy: the reference would keep the query and its context alive, and pybind11 takes
        # an old wrapper for whatever context comes to stand at its address.
        self._version = GeometryVersion(version)


def bounds_before(corners: NDArray, near: float) -> tuple[NDArray, NDArray]:
    """Return least and largest X/Z, Y/Z of what of boxes is beyond a distance.

    Args:
        corners: Of the boxes, those of a cube in the order of `CORNERS`. Shape (k, 8, 3).
        near: The distance along Z [m].

    Returns:
        Shapes (k, 2); inf and -inf where nothing is.
    """
    a, b = corners[:, _EDGES[0]], corners[:, _EDGES[1]]
    with np.errstate(divide="ignore", invalid="ignore"):
        share = (near - a[..., 2:]) / (b[..., 2:] - a[..., 2:])
        met = np.where((share >= 0.0) & (share <= 1.0), a + share * (b - a), np.nan)
    beyond = np.where(corners[..., 2:] > near, corners, np.nan)
    points = np.concatenate([beyond, met], axis=1)
    rays = points[..., :2] / points[..., 2:]
    low = np.where(np.isnan(rays), np.inf, rays).min(axis=1)
    return low, np.where(np.isnan(rays), -np.inf, rays).max(axis=1)
