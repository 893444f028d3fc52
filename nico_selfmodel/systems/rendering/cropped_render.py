"""Rendering large pictures of which most is empty background.

A software renderer's time goes by the pixel, whether it shows something or not. A coarse picture of
labels tells where anything is, and only that part is rendered in full.
"""

from dataclasses import dataclass

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

_COARSE = 4
"""Pixels to the side of one of the coarse picture."""
_STEP = 64
"""Sides of what is rendered are multiples of this, so that buffers can be used again [px]."""
_NEAR, _FAR = 0.01, 4.99
"""What is nearer is cut off, unless told otherwise, and how much farther is rendered [m]."""


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

    def __call__(self, query: QueryObject) -> NDArray:
        """Render. Red, green, blue, opacity, 8 bits, shape (height, width, 4).

        What is smaller than four pixels and far from everything else may be missed.

        Raises:
            RuntimeError: If the scene graph has no such renderer.
        """
        return self._whole(query, self._window(query))

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
        depth[top:bottom, left:right] = found.data[:, :, 0]
        return self._whole(query, window), depth

    def _whole(self, query: QueryObject, window: tuple[int, int, int, int]) -> NDArray:
        """Return the whole picture after rendering a part of it."""
        left, top, right, bottom = window
        if window == (0, 0, *self.size):
            return self._render(query, window)
        part = self._render(query, window)
        # A background that is not plain must be rendered everywhere.
        color = self._plain_border(part, window)
        if color is None:
            return self._render(query, (0, 0, *self.size))
        # Four bytes at once: filling a large picture colour by colour takes longer than rendering.
        plain = np.ascontiguousarray(color).view(np.uint32)
        whole = np.full((self.size[1], self.size[0]), plain).view(np.uint8)
        whole = whole.reshape(self.size[1], self.size[0], 4)
        whole[top:bottom, left:right] = part
        return whole

    def _window(self, query: QueryObject) -> tuple[int, int, int, int]:
        """Return first and last column and row of a window around all that is there."""
        width, height = self.size
        small = (-(-width // _COARSE), -(-height // _COARSE))
        camera = self._camera(self.K / _COARSE, small)
        labels = query.RenderLabelImage(camera, self.frame, self.X_FC).data[:, :, 0]
        there = labels != int(RenderLabel.kEmpty)
        # Drake wants the principal point inside what it renders.
        cx, cy = (int(self.K[i, 2] / _COARSE) for i in (0, 1))
        window = []
        for axis, center, size in ((0, cx, width), (1, cy, height)):
            used = np.flatnonzero(there.any(axis=axis))
            first, last = (min(used.min(), center), max(used.max(), center)) if len(used) else (
                center, center
            )  # fmt: skip
            low = max(0, (int(first) - 2) * _COARSE)
            high = min(size, (int(last) + 3) * _COARSE)
            side = min(size, -(-(high - low) // _STEP) * _STEP)
            low = min(low, size - side)
            window += [low, low + side]
        left, right, top, bottom = window
        return left, top, right, bottom

    def _render(self, query: QueryObject, window: tuple[int, int, int, int]) -> NDArray:
        left, top, right, bottom = window
        camera = self._camera(self._cropped(window), (right - left, bottom - top))
        return query.RenderColorImage(camera, self.frame, self.X_FC).data.copy()

    def _cropped(self, window: tuple[int, int, int, int]) -> NDArray:
        """Return the intrinsic matrix of a part of the picture."""
        return self.K - np.array([[0.0, 0.0, window[0]], [0.0, 0.0, window[1]], [0.0, 0.0, 0.0]])

    def _camera(self, K: NDArray, size: tuple[int, int]) -> ColorRenderCamera:
        info = CameraInfo(*size, K[0, 0], K[1, 1], K[0, 2], K[1, 2])
        clipping = ClippingRange(self.near, self.near + _FAR)
        core = RenderCameraCore(self.renderer, info, clipping, RigidTransform())
        return ColorRenderCamera(core, False)

    def _plain_border(self, part: NDArray, window: tuple[int, int, int, int]) -> NDArray | None:
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
