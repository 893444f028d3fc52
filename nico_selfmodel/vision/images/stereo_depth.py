"""Dense stereo of a calibrated pair: how far away what each pixel shows is."""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.geometry.transform import apply, inverse, transform
from nico_selfmodel.model.cameras.camera import Camera
from nico_selfmodel.model.cameras.stereo_rig import StereoRig

_BLOCK = 5
"""Sides of what is matched [px]."""
_BEND, _JUMP = 8, 32
"""What a step of a disparity costs, and a jump, each pixel and channel of a block."""
_STEPS = 16.0
"""Disparities that a pixel is divided into."""


@dataclass(frozen=True, eq=False)
class RectifiedPair:
    """Two cameras turned to look alike, side by side, and pictures bent to what they would see."""

    rig: StereoRig
    """The real ones."""
    turned: tuple[Camera, Camera]
    """Left and right, turned and without lenses."""
    baseline: float
    """Between them [m]."""
    _maps: tuple[tuple[NDArray, NDArray], tuple[NDArray, NDArray]]
    """Where each of their pixels comes from: columns and rows."""

    @classmethod
    def of(cls, rig: StereoRig, scale: float = 1.0) -> "RectifiedPair":
        """Turn a pair.

        The common x axis goes from one centre to the other; z is as near as it can be to the mean
        of both optical axes (Fusiello, Trucco and Verri 2000).

        Args:
            scale: Pixels of the turned cameras, a pixel of the real ones.
        """
        left, right = rig.cameras
        across = right.X_WC[:3, 3] - left.X_WC[:3, 3]
        x = across / np.linalg.norm(across)
        ahead = left.X_WC[:3, 2] + right.X_WC[:3, 2]
        y = np.cross(ahead, x)
        y = y / np.linalg.norm(y)
        R_WE = np.stack([x, y, np.cross(x, y)], axis=1)
        width, height = (round(scale * n) for n in left.image_size)
        focal = scale * left.fx
        turned = [
            Camera(focal, focal, scale * (c.cx + 0.5) - 0.5, scale * (left.cy + 0.5) - 0.5,
                   (width, height), X_WC=transform(R_WE, c.X_WC[:3, 3]))
            for c in (left, left.at(right.X_WC))
        ]  # fmt: skip
        maps = [_map(real, own) for real, own in zip((left, right), turned, strict=True)]
        return cls(rig, (turned[0], turned[1]), float(np.linalg.norm(across)), (maps[0], maps[1]))

    def bent(self, picture: NDArray, side: int) -> NDArray:
        """Return what a turned camera would have seen. Shape (h, w, ...)."""
        columns, rows = self._maps[side]
        return cv2.remap(picture, columns, rows, cv2.INTER_LINEAR)

    def unbent(self, values: NDArray, side: int) -> NDArray:
        """Return what the real camera's pixels have of a turned one's, by the nearest; else 0.

        Args:
            values: Of the turned camera's pixels. Shape (h, w).
            side: Of which camera, 0 or 1.
        """
        real, turned = self.rig.cameras[side], self.turned[side]
        width, height = real.image_size
        u, v = np.meshgrid(np.arange(width), np.arange(height))
        ways = real.directions(np.stack([u.ravel(), v.ravel()], axis=1)) @ real.X_WC[:3, :3].T
        pixels = turned.project(turned.X_WC[:3, 3] + ways).reshape(height, width, 2)
        columns, rows = np.nan_to_num(pixels, nan=-1.0).astype(np.float32).transpose(2, 0, 1)
        return cv2.remap(values, columns, rows, cv2.INTER_NEAREST)

    def points(self, depth: NDArray, pixels: NDArray, side: int) -> NDArray:
        """Return where in W is what pixels of a turned camera show [m].

        Args:
            depth: As of `depth` [m]. Shape (N,).
            pixels: u and v. Shape (N, 2).
            side: Of which camera, 0 or 1.
        """
        turned = self.turned[side]
        ideal = (pixels - [turned.cx, turned.cy]) / [turned.fx, turned.fy]
        return apply(turned.X_WC, np.column_stack([ideal * depth[:, None], depth]))

    def depth(self, pictures: tuple[NDArray, NDArray], nearest: float, side: int = 0) -> NDArray:
        """Return the distance along the turned axis of what one picture shows.

        By semi-global matching (Hirschmueller 2008); what both pictures do not agree on is nan.

        Args:
            pictures: Left and right, as taken, BGR, 8 bits. Shape (h, w, 3) each.
            nearest: What is nearer is not looked for [m].
            side: Of which picture, 0 or 1.

        Returns:
            Depths [m]. Shape (h, w) of the turned camera.
        """
        left, right = (self.bent(picture, k) for k, picture in enumerate(pictures))
        if side:  # seen in a mirror, the right one is the left one
            left, right = right[:, ::-1], left[:, ::-1]
        most = int(np.ceil(self.turned[0].fx * self.baseline / nearest / 16.0)) * 16
        area = 3 * _BLOCK**2
        matcher = cv2.StereoSGBM.create(
            0, most, _BLOCK, _BEND * area, _JUMP * area, disp12MaxDiff=1, uniquenessRatio=0,
            speckleWindowSize=60, speckleRange=2, mode=cv2.STEREO_SGBM_MODE_HH,
        )  # fmt: skip
        # What a disparity shifts out of the picture is not matched: the left gets a border.
        wide = [cv2.copyMakeBorder(p, 0, 0, most, 0, cv2.BORDER_REPLICATE) for p in (left, right)]
        disparity = matcher.compute(*wide)[:, most:] / _STEPS
        disparity = disparity[:, ::-1] if side else disparity
        with np.errstate(divide="ignore"):
            return np.where(disparity > 0.0, self.turned[0].fx * self.baseline / disparity, np.nan)


def _map(real: Camera, turned: Camera) -> tuple[NDArray, NDArray]:
    """Return where the pixels of a turned camera are in the real one's picture."""
    width, height = turned.image_size
    u, v = np.meshgrid(np.arange(width), np.arange(height))
    ways = np.stack([(u - turned.cx) / turned.fx, (v - turned.cy) / turned.fy, np.ones(u.shape)])
    ways = np.einsum("ij,jkl->ikl", (inverse(real.X_WC) @ turned.X_WC)[:3, :3], ways)
    columns, rows = real.pixels_of(ways[:2] / ways[2])
    return columns.astype(np.float32), rows.astype(np.float32)
