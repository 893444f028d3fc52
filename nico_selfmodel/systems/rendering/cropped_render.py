"""Rendering large pictures of which most is empty background.

A software renderer's time goes by the pixel, whether it shows something or not. The boxes around
all that is drawn, or where they do not tell a coarse picture of labels, say where anything is, and
only that part is rendered in full.
"""

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

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
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.systems.sensors import CameraInfo

from nico_selfmodel.systems.closing import trim_memory
from nico_selfmodel.systems.rendering.outlines import Beside, Outlines
from nico_selfmodel.systems.rendering.turned_view import TurnedView

_COARSE = 4
"""Pixels to the side of one of the coarse picture."""
_STEP = 64
"""Sides of what is rendered are multiples of this, so that buffers can be used again [px]."""
_NEAR, _FAR = 0.01, 4.99
"""What is nearer is cut off, unless told otherwise, and how much farther is rendered [m]."""
_SMALL, _BEYOND = 64, RigidTransform(p=[0.0, 0.0, 50.0])
"""Side of a picture of nothing [px], and from where one sees nothing upwards."""
_SMALL_K = np.array([[_SMALL, 0.0, _SMALL / 2], [0.0, _SMALL, _SMALL / 2], [0.0, 0.0, 1.0]])
_REMEMBERED = 1000
"""Boxes beside the camera that are remembered at most."""
_MARGIN = 4
"""Pixels around a box, whose edges smoothing may spread."""
_WORTH_TURNING = 0.8
"""Share of the pixels that are left where a camera is turned to what is to be seen."""

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
class RenderedPart:
    """A part of a picture, outside of which everything is plain."""

    picture: NDArray
    """Red, green, blue, opacity, 8 bits. Shape (h, w, 4)."""
    window: Window
    """What of the whole picture it shows."""
    color: NDArray
    """Of all the rest. Shape (4,)."""
    H: NDArray | None = None
    """Of a camera that was turned: from X/Z, Y/Z, 1 to places in the part, from the edge of its
    first pixel. Shape (3, 3)."""


@dataclass(frozen=True, eq=False)
class CroppedRender:
    """A pinhole camera that leaves out empty background.

    Raises:
        RuntimeError: From its methods, if the scene graph has no such renderer.
    """

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
    turns: bool = True
    """Whether a part may be seen by a turned camera. What stands still behind is drawn otherwise
    then whenever something moves before it, as if it moved, too."""
    outlines: Outlines = field(default_factory=Outlines)
    """Boxes around all that is drawn."""
    _unseen: set[Beside] = field(default_factory=set)
    """Boxes beside the camera that a picture of labels has shown to hold nothing to be seen."""

    def __call__(self, query: QueryObject) -> NDArray:
        """Render. Red, green, blue, opacity, 8 bits, shape (height, width, 4).

        What is smaller than four pixels and far from everything else may be missed.
        """
        return self._whole(query, self._window(query))

    def part(self, query: QueryObject) -> RenderedPart:
        """Render only where anything is, by a turned camera where that is less."""
        bounds = self._bounds(query)
        window = self._around(bounds)
        if self.turns and bounds is not None:
            part = self._turned(query, bounds, (window[2] - window[0]) * (window[3] - window[1]))
            if part is not None:
                return part
        return self._upright(query, window)

    def _upright(self, query: QueryObject, window: Window) -> RenderedPart:
        """Render a window, or everything where its sides are not plain."""
        part = self._render(query, window)
        if window == (0, 0, *self.size):
            return RenderedPart(part, window, part[0, 0])
        color = self._plain_border(part, window)
        if color is None:
            # A background that is not plain must be rendered everywhere.
            window = (0, 0, *self.size)
            part = self._render(query, window)
            color = part[0, 0]
        return RenderedPart(part, window, color)

    def _turned(self, query: QueryObject, bounds: Bounds, pixels: int) -> RenderedPart | None:
        """Render what lies within bounds by a camera that is turned to it.

        Args:
            bounds: Around all that is to be seen.
            pixels: How many would have to be rendered otherwise.

        Returns:
            None where that is little less, or the background not plain.
        """
        focal, middle = np.diag(self.K)[:2], self.K[:2, 2]
        limits = np.array([bounds[:2], bounds[2:]])
        limits = np.clip(limits, 0.0, self.size).astype(int)
        if (limits[0] >= limits[1]).any():
            return None
        (left, top), (right, bottom) = (limits - middle) / focal
        corners = np.array([[left, top], [right, top], [right, bottom], [left, bottom]])
        view = TurnedView.of(corners, focal)
        if view.area > _WORTH_TURNING * pixels:
            return None
        found = self._through(query, view)
        rows, columns, rays = view.border()
        places = rays * focal + middle
        sides = found[rows, columns][np.all((places > 0.0) & (places < self.size), axis=1)]
        if not len(sides) or (sides != sides[0]).any():
            return None
        (left, top), (right, bottom) = limits.tolist()
        return RenderedPart(found, (left, top, right, bottom), sides[0], view.H)

    def cone_about(
        self, query: QueryObject, frame: FrameId, p_FS: NDArray, radius: float
    ) -> tuple[NDArray, float]:
        """Return in which directions a ball is.

        Args:
            frame: Of the ball.
            p_FS: Its middle there [m]. Shape (3,).
            radius: [m].

        Returns:
            Unit vector to its middle in the camera, shape (3,), and the angle that it reaches to
            all sides of that [rad].
        """
        X_CF = (query.GetPoseInWorld(self.frame) @ self.X_FC).inverse() @ query.GetPoseInWorld(
            frame
        )
        p_CS = X_CF @ p_FS
        away = float(np.linalg.norm(p_CS))
        return p_CS / away, float(np.arcsin(min(radius / away, 1.0)))

    def turned_to(self, query: QueryObject, rays: NDArray) -> tuple[NDArray, NDArray]:
        """Render what lies around rays by a camera that is turned to it.

        Args:
            rays: X/Z, Y/Z. Shape (N, 2).

        Returns:
            The picture, red, green, blue, opacity, and the homography from X/Z, Y/Z, 1 to places in
            it, from the edge of its first pixel. Shapes (h, w, 4) and (3, 3).
        """
        view = TurnedView.of(rays, np.diag(self.K)[:2])
        return self._through(query, view), view.H

    def _through(self, query: QueryObject, view: TurnedView) -> NDArray:
        # What is nearer than the camera's own near plane, as its case, must not come into view.
        camera = self._camera(view.K, view.size, self.near * view.deepest)
        turn = RigidTransform(RotationMatrix(view.R_CT), np.zeros(3))
        return query.RenderColorImage(camera, self.frame, self.X_FC @ turn).data.copy()

    def with_depth(self, query: QueryObject) -> tuple[NDArray, NDArray]:
        """Render colours and the distance along the optical axis [m], inf where nothing is."""
        window = self._window(query)
        depth = self._depths(query, window)
        self._nothing(query, query.RenderDepthImage, self._ranging)
        return self._whole(query, window), depth

    def emptied(self, query: QueryObject) -> None:
        """Let the renderer give back what it keeps of its last picture."""
        self._nothing(query, query.RenderColorImage, self._camera)

    def _depths(self, query: QueryObject, window: Window) -> NDArray:
        """Return distances in a window, inf elsewhere. Shape (h, w)."""
        left, top, right, bottom = window
        camera = self._ranging(self._cropped(window), (right - left, bottom - top))
        depth = np.full((self.size[1], self.size[0]), np.inf, np.float32)
        found = query.RenderDepthImage(camera, self.frame, self.X_FC)
        # What is too near to be measured has depth 0 in Drake; it is drawn where clipping begins.
        depth[top:bottom, left:right] = np.maximum(found.data[:, :, 0], self.near)
        return depth

    def _ranging(self, K: NDArray, size: tuple[int, int]) -> DepthRenderCamera:
        core = self._camera(K, size).core()
        return DepthRenderCamera(core, DepthRange(self.near, self.near + _FAR))

    def with_labels(self, query: QueryObject) -> LabelledPicture:
        """Render colours, distances and labels."""
        left, top, right, bottom = window = self._window(query)
        color, depth = self.with_depth(query)
        self._nothing(query, query.RenderColorImage, self._camera)
        camera = self._camera(self._cropped(window), (right - left, bottom - top))
        labels = np.full(depth.shape, int(RenderLabel.kEmpty), np.int16)
        found = query.RenderLabelImage(camera, self.frame, self.X_FC)
        labels[top:bottom, left:right] = found.data[:, :, 0]
        self._nothing(query, query.RenderLabelImage, self._camera)
        trim_memory()
        return LabelledPicture(color, depth, labels)

    def _nothing(
        self, query: QueryObject, render: Callable[..., Any], camera: Callable[..., Any]
    ) -> None:
        """Render a small picture of nothing.

        A renderer keeps buffers as large as its last picture of each kind, 0.1 GB in all: before it
        draws the next kind, such a picture takes their place.

        Args:
            render: Of the query, which draws one kind.
            camera: Of that kind, by its matrix and size.
        """
        small = camera(_SMALL_K, (_SMALL, _SMALL))
        render(small, query.inspector().world_frame_id(), _BEYOND)

    def _whole(self, query: QueryObject, window: Window) -> NDArray:
        """Return the whole picture after rendering a part of it."""
        found = self._upright(query, window)
        left, top, right, bottom = found.window
        # Four bytes at once: filling a large picture colour by colour takes longer than rendering.
        plain = np.ascontiguousarray(found.color).view(np.uint32)
        whole = np.full((self.size[1], self.size[0]), plain).view(np.uint8)
        whole = whole.reshape(self.size[1], self.size[0], 4)
        whole[top:bottom, left:right] = found.picture
        return whole

    def _window(self, query: QueryObject) -> Window:
        """Return a window around all that is there."""
        return self._around(self._bounds(query))

    def _bounds(self, query: QueryObject) -> Bounds | None:
        """Return bounds of all that is there; None where nothing is."""
        X_WC = query.GetPoseInWorld(self.frame) @ self.X_FC
        outline = self.outlines.before(query, X_WC, self.near, self.near + _FAR)
        if outline is None:
            return self._labelled(query)[0]
        focal, middle = np.diag(self.K)[:2], self.K[:2, 2]
        low, high = outline.low * focal + middle, outline.high * focal + middle
        inside = np.all((high > 0.0) & (low < self.size), axis=1)
        first = len(inside) - len(outline.beside)
        doubtful = [box for box, i in zip(outline.beside, inside[first:], strict=True) if i]
        if not self._unseen.issuperset(doubtful):
            bounds, shown = self._labelled(query)
            if any(label in shown for _, label in doubtful):
                return bounds
            if len(self._unseen) > _REMEMBERED:
                self._unseen.clear()
            self._unseen.update(doubtful)
        inside[first:] = False
        if not inside.any():
            return None
        low, high = np.floor(low[inside].min(axis=0)), np.ceil(high[inside].max(axis=0))
        return (*(low - _MARGIN).tolist(), *(high + _MARGIN).tolist())

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

    def _camera(
        self, K: NDArray, size: tuple[int, int], near: float | None = None
    ) -> ColorRenderCamera:
        near = near or self.near
        info = CameraInfo(*size, K[0, 0], K[1, 1], K[0, 2], K[1, 2])
        clipping = ClippingRange(near, near + _FAR)
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
