"""Rendering large pictures of which most is empty background.

A software renderer's time goes by the pixel, whether it shows something or not. The boxes around
all that is drawn, or where they do not tell a coarse picture of labels, say where anything is, and
only that part is rendered in full.
"""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from pydrake.geometry import (
    ClippingRange,
    ColorRenderCamera,
    DepthRange,
    DepthRenderCamera,
    FrameId,
    QueryObject,
    RenderCameraCore,
    RenderLabel,
)
from pydrake.math import RigidTransform
from pydrake.systems.sensors import CameraInfo

from nico_selfmodel.systems.rendering.outlines import Beside, Outlines

_COARSE = 4
"""Pixels to the side of one of the coarse picture."""
_STEP = 64
"""Sides of what is rendered are multiples of this, so that buffers can be used again [px]."""
_NEAR, _FAR = 0.01, 4.99
"""What is nearer is cut off, unless told otherwise, and how much farther is rendered [m]."""


_REMEMBERED = 1000
"""Boxes beside the camera that are remembered at most."""
_MARGIN = 4
"""Pixels around a box, whose edges smoothing may spread."""

Window = tuple[int, int, int, int]
"""First column and row of a part of a picture, and the first ones beyond it [px]."""
Bounds = tuple[float, float, float, float]
"""The same of what is to be seen, which may lie beyond the picture."""


@dataclass(frozen=True, eq=False)
class LabelledPicture:
    """What a camera sees, how far away and of what."""

    color: NDArray
    """Red, green, blue, opacity, 8 bits. Shape (h, w, 4)."""
    depth: NDArray
    """Distance along the optical axis [m], inf where nothing is. Shape (h, w)."""
    labels: NDArray
    """Numbers that label images have. Shape (h, w)."""


@dataclass(frozen=True, eq=False)
class CroppedRender:
    """A pinhole camera that leaves out empty background."""

    renderer: str
    """Name of the renderer in the scene graph."""
    size: tuple[int, int]
    """Width and height of the whole picture [px]."""
    K: NDArray
    """Intrinsic matrix, from the edge of the first pixel [px]. Shape (3, 3)."""
    frame: FrameId
    """What the camera is mounted on."""
    X_FC: RigidTransform
    """How."""
    near: float = _NEAR
    """What is nearer along the optical axis is cut off [m]."""
    outlines: Outlines = field(default_factory=Outlines)
    """Boxes around all that is drawn."""
    _unseen: set[Beside] = field(default_factory=set)
    """Boxes beside the camera that a picture of labels has shown to hold nothing to be seen."""

    def __call__(self, query: QueryObject) -> NDArray:
        """Render. Red, green, blue, opacity, 8 bits, shape (height, width, 4).

        What is smaller than four pixels and far from everything else may be missed.

        Raises:
            RuntimeError: If the scene graph has no such renderer.
        """
        return self._whole(query, self._window(query))

    def part(
        self, query: QueryObject, window: Window | None = None
    ) -> tuple[NDArray, Window, NDArray]:
        """Render only where anything is.

        Args:
            query: Of the scene graph.
            window: Where that is, if it is known.

        Returns:
            That part, the window it fills, and the one colour of all the rest.

        Raises:
            RuntimeError: If the scene graph has no such renderer.
        """
        window = window or self._window(query)
        part = self._render(query, window)
        if window == (0, 0, *self.size):
            return part, window, part[0, 0]
        color = self._plain_border(part, window)
        if color is None:
            # A background that is not plain must be rendered everywhere.
            window = (0, 0, *self.size)
            part = self._render(query, window)
            color = part[0, 0]
        return part, window, color

    def with_depth(self, query: QueryObject) -> tuple[NDArray, NDArray]:
        """Render colours and the distance along the optical axis [m], inf where nothing is.

        Raises:
            RuntimeError: If the scene graph has no such renderer.
        """
        left, top, right, bottom = window = self._window(query)
        core = self._camera(self._cropped(window), (right - left, bottom - top)).core()
        camera = DepthRenderCamera(core, DepthRange(self.near, self.near + _FAR))
        depth = np.full((self.size[1], self.size[0]), np.inf, np.float32)
        found = query.RenderDepthImage(camera, self.frame, self.X_FC)
        # What is too near to be measured has depth 0 in Drake; it is drawn where clipping begins.
        depth[top:bottom, left:right] = np.maximum(found.data[:, :, 0], self.near)
        return self._whole(query, window), depth

    def with_labels(self, query: QueryObject) -> LabelledPicture:
        """Render colours, distances and labels.

        Raises:
            RuntimeError: If the scene graph has no such renderer.
        """
        color, depth = self.with_depth(query)
        left, top, right, bottom = window = self._window(query)
        camera = self._camera(self._cropped(window), (right - left, bottom - top))
        labels = np.full(depth.shape, int(RenderLabel.kEmpty), np.int16)
        found = query.RenderLabelImage(camera, self.frame, self.X_FC)
        labels[top:bottom, left:right] = found.data[:, :, 0]
        return LabelledPicture(color, depth, labels)

    def _whole(self, query: QueryObject, window: Window) -> NDArray:
        """Return the whole picture after rendering a part of it."""
        part, window, color = self.part(query, window)
        left, top, right, bottom = window
        # Four bytes at once: filling a large picture colour by colour takes longer than rendering.
        plain = np.ascontiguousarray(color).view(np.uint32)
        whole = np.full((self.size[1], self.size[0]), plain).view(np.uint8)
        whole = whole.reshape(self.size[1], self.size[0], 4)
        whole[top:bottom, left:right] = part
        return whole

    def _window(self, query: QueryObject) -> Window:
        """Return first and last column and row of a window around all that is there."""
        X_WC = query.GetPoseInWorld(self.frame) @ self.X_FC
        outline = self.outlines.before(query, X_WC, self.near, self.near + _FAR)
        if outline is None:
            return self._around(self._labelled(query)[0])
        focal, middle = np.diag(self.K)[:2], self.K[:2, 2]
        low, high = outline.low * focal + middle, outline.high * focal + middle
        inside = np.all((high > 0.0) & (low < self.size), axis=1)
        first = len(inside) - len(outline.beside)
        doubtful = [box for box, i in zip(outline.beside, inside[first:], strict=True) if i]
        if not self._unseen.issuperset(doubtful):
            bounds, shown = self._labelled(query)
            if any(label in shown for _, label in doubtful):
                return self._around(bounds)
            if len(self._unseen) > _REMEMBERED:
                self._unseen.clear()
            self._unseen.update(doubtful)
        inside[first:] = False
        if not inside.any():
            return self._around(None)
        low, high = np.floor(low[inside].min(axis=0)), np.ceil(high[inside].max(axis=0))
        return self._around((*(low - _MARGIN).tolist(), *(high + _MARGIN).tolist()))

    def _labelled(self, query: QueryObject) -> tuple[Bounds | None, set[int]]:
        """Return where a coarse picture shows anything, and which labels it shows."""
        width, height = self.size
        small = (-(-width // _COARSE), -(-height // _COARSE))
        camera = self._camera(self.K / _COARSE, small)
        labels = query.RenderLabelImage(camera, self.frame, self.X_FC).data[:, :, 0]
        shown = set(np.unique(labels).tolist())
        rows, columns = np.nonzero(labels != int(RenderLabel.kEmpty))
        if not len(rows):
            return None, shown
        low = _COARSE * (columns.min() - 2), _COARSE * (rows.min() - 2)
        return (*low, _COARSE * (columns.max() + 3), _COARSE * (rows.max() + 3)), shown

    def _around(self, bounds: Bounds | None) -> Window:
        """Return a window around what lies within bounds and the principal point."""
        # Drake wants the principal point inside what it renders.
        center = self.K[:2, 2]
        window = []
        for axis in (0, 1):
            size, least, most = self.size[axis], center[axis] - _COARSE, center[axis] + _COARSE
            if bounds is not None:
                least, most = min(least, bounds[axis]), max(most, bounds[axis + 2])
            low, high = max(0, int(least)), min(size, int(most))
            side = min(size, -(-(high - low) // _STEP) * _STEP)
            low = min(low, size - side)
            window += [low, low + side]
        left, right, top, bottom = window
        return left, top, right, bottom

    def _render(self, query: QueryObject, window: Window) -> NDArray:
        left, top, right, bottom = window
        camera = self._camera(self._cropped(window), (right - left, bottom - top))
        return query.RenderColorImage(camera, self.frame, self.X_FC).data.copy()

    def _cropped(self, window: Window) -> NDArray:
        """Return the intrinsic matrix of a part of the picture."""
        return self.K - np.array([[0.0, 0.0, window[0]], [0.0, 0.0, window[1]], [0.0, 0.0, 0.0]])

    def _camera(self, K: NDArray, size: tuple[int, int]) -> ColorRenderCamera:
        info = CameraInfo(*size, K[0, 0], K[1, 1], K[0, 2], K[1, 2])
        clipping = ClippingRange(self.near, self.near + _FAR)
        core = RenderCameraCore(self.renderer, info, clipping, RigidTransform())
        return ColorRenderCamera(core, False)

    def _plain_border(self, part: NDArray, window: Window) -> NDArray | None:
        """Return the one colour of a window's sides inside the picture; None if there are more."""
        left, top, right, bottom = window
        sides = []
        if left > 0:
            sides.append(part[:, 0])
        if right < self.size[0]:
            sides.append(part[:, -1])
        if top > 0:
            sides.append(part[0])
        if bottom < self.size[1]:
            sides.append(part[-1])
        border = np.concatenate(sides)
        return border[0] if (border == border[0]).all() else None
