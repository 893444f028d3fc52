"""What a flat mirror does to the picture of a pinhole camera.

Through the glass a camera sees the world as its reflected twin behind the glass sees it through the
same glass. That twin is rendered as a camera that looks straight out of the glass: its near
clipping plane can then be the glass itself, which cuts off all that stands behind the mirror. The
glass is one plane to both cameras, so that a homography carries the twin's picture into the
camera's; it also turns left and right round.
"""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.geometry.homography import apply_homography
from nico_selfmodel.geometry.transform import inverse, transform

_LARGEST = 3072
"""Longest side of the twin's picture; what is seen at a grazing angle has to do with less [px]."""
_SHARPNESS = 0.75
"""Pixels of the twin's picture to one of the camera's, which takes several samples a pixel."""
_MARGIN = 4
"""Pixels of the twin's picture around the glass, for the interpolation."""
_NEAREST = 1e-3
"""A camera nearer to the plane of the glass sees it edge-on [m]."""
_TOLERANCE = 1e-3
"""What is this little before the glass counts as lying on it [m]."""
_SUBPIXEL = 4
"""Binary digits of the outline's pixel coordinates."""
_SILVER = 0.93
"""Share of the light that a mirror throws back."""
_TURNED = np.diag([-1.0, 1.0, -1.0])


@dataclass(frozen=True, eq=False)
class GlassInView:
    """A rectangle of glass as one pinhole camera has it in view.

    In the frame M of the glass x is right and y down for whoever looks into it, along z.
    """

    K: NDArray
    """Intrinsic matrix of the camera, from the edge of the first pixel [px]. Shape (3, 3)."""
    X_CM: NDArray
    """Pose of the glass before the camera. Shape (4, 4)."""
    outline: NDArray
    """Corners of what can be seen of the glass, in M [m]. Shape (k, 2)."""

    @classmethod
    def of(
        cls, K: NDArray, image_size: tuple[int, int], X_CM: NDArray, glass_size: tuple[float, float]
    ) -> "GlassInView | None":
        """Look at a glass.

        Args:
            K: Intrinsic matrix, from the edge of the first pixel [px]. Shape (3, 3).
            image_size: Width and height of the picture [px].
            X_CM: Pose of the glass before the camera. Shape (4, 4).
            glass_size: Width and height [m].

        Returns:
            The view; None where nothing of the glass is in it, or only its edge.
        """
        if abs(inverse(X_CM)[2, 3]) < _NEAREST:
            return None
        H = _from_plane(K, X_CM)
        width, height = image_size
        half = 0.5 * np.array(glass_size)
        outline = half * [[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]]
        before = H[2] - np.array([0.0, 0.0, _NEAREST])
        # Before the camera, right of the picture's left edge, left of its right one, and so on.
        for row in (before, H[0], width * H[2] - H[0], H[1], height * H[2] - H[1]):
            outline = _clipped(outline, row)
            if len(outline) < 3:
                return None
        return cls(K, X_CM, outline)

    @property
    def center(self) -> NDArray:
        """The camera's centre in M [m]. Shape (3,)."""
        return inverse(self.X_CM)[:3, 3]

    @property
    def faces_camera(self) -> bool:
        """Whether the camera is before the glass, not behind it."""
        return bool(self.center[2] < 0.0)

    @property
    def distance(self) -> float:
        """Distance of the camera, and of its twin, from the plane of the glass [m]."""
        return abs(float(self.center[2]))

    @property
    def X_MV(self) -> NDArray:
        """Pose of the twin V, which looks straight out of the glass. Shape (4, 4)."""
        return transform(_TURNED, self.center * [1.0, 1.0, -1.0])

    @property
    def twin(self) -> tuple[NDArray, tuple[int, int]]:
        """Intrinsic matrix of the twin [px], shape (3, 3), and the size of its picture [px].

        The picture holds what is seen of the glass, and the principal point, as Drake wants it.
        """
        where = (self.outline - self.center[:2]) * _TURNED.diagonal()[:2]
        where = np.concatenate([where, np.zeros((1, 2))])
        low, high = where.min(axis=0), where.max(axis=0)
        largest = (_LARGEST - 2 * _MARGIN) / float((high - low).max())
        scale = min(_SHARPNESS * self._pixels_a_metre(), largest)
        center = np.ceil(-low * scale) + _MARGIN
        size = np.ceil(center + high * scale).astype(int) + _MARGIN
        K = np.diag([scale * self.distance, scale * self.distance, 1.0])
        K[:2, 2] = center
        return K, (int(size[0]), int(size[1]))

    def places(self, shape: tuple[int, ...]) -> NDArray:
        """Return the places of the glass that the middles of the twin's pixels show.

        Args:
            shape: Of the twin's picture (h, w).

        Returns:
            In M [m]. Shape (h, w, 2).
        """
        K, _ = self.twin
        v, u = np.mgrid[: shape[0], : shape[1]] + 0.5
        seen = np.stack([u - K[0, 2], v - K[1, 2]], axis=2) * (self.distance / K[0, 0])
        return self.center[:2] + seen * _TURNED.diagonal()[:2]

    def pixels(self, places: NDArray) -> NDArray:
        """Return where the twin's picture shows places of the glass, as OpenCV counts.

        Args:
            places: In M [m]. Shape (..., 2).

        Returns:
            Of the middle of the first pixel 0 [px]. Shape (..., 2), 32 bits.
        """
        K, _ = self.twin
        seen = (places - self.center[:2]) * _TURNED.diagonal()[:2]
        found = seen * (K[0, 0] / self.distance) + K[:2, 2] - 0.5
        return found.astype(np.float32)

    def show(
        self, picture: NDArray, depth: NDArray, shown: NDArray | tuple[int, ...], K: NDArray | None
    ) -> None:
        """Put what the glass shows into a picture, where nothing stands before it.

        Args:
            picture: The camera's picture, changed in place; 8 bits. Shape (h, w, channels).
            depth: Distance along the optical axis of what the camera sees [m], changed to that of
                the glass where that is seen. Shape (h, w).
            shown: The twin's picture, shape (h', w', channels), or one colour.
            K: The twin's intrinsic matrix; None with one colour. Shape (3, 3).
        """
        H = _from_plane(self.K, self.X_CM)
        corners = apply_homography(H, self.outline)
        low = np.maximum(np.floor(corners.min(axis=0)).astype(int), 0)
        high = np.minimum(np.ceil(corners.max(axis=0)).astype(int), picture.shape[1::-1])
        if (high <= low).any():
            return
        window = slice(low[1], high[1]), slice(low[0], high[0])
        mask = np.zeros((high - low)[::-1], np.uint8)
        # OpenCV counts from the centre of the first pixel.
        fixed = np.rint((corners - low - 0.5) * 2**_SUBPIXEL).astype(np.int32)
        cv2.fillConvexPoly(mask, fixed, 255, shift=_SUBPIXEL)
        glass = self._depth_of(low, high)
        cv2.bitwise_and(mask, cv2.compare(glass, depth[window] + _TOLERANCE, cv2.CMP_LT), dst=mask)
        cv2.copyTo(glass, mask, depth[window])
        if K is None:
            seen = np.full((*mask.shape, picture.shape[2]), shown, np.uint8)
        else:
            twin = _from_plane(K, inverse(self.X_MV))
            to_window = _moved(-low - 0.5) @ H @ np.linalg.inv(twin) @ _moved(np.full(2, 0.5))
            seen = cv2.warpPerspective(
                np.asarray(shown),
                to_window,
                (int(high[0] - low[0]), int(high[1] - low[1])),
                flags=cv2.INTER_LINEAR,
                borderMode=cv2.BORDER_REPLICATE,
            )
            cv2.convertScaleAbs(seen, dst=seen, alpha=_SILVER)
        cv2.copyTo(seen, mask, picture[window])

    def _pixels_a_metre(self) -> float:
        """Return how many of the camera's pixels a metre of glass covers in its middle."""
        H = _from_plane(self.K, self.X_CM)
        u, v, w = H @ [*self.outline.mean(axis=0), 1.0]
        slopes = (H[:2, :2] - np.outer([u / w, v / w], H[2, :2])) / w
        return float(np.linalg.norm(slopes, 2))

    def _depth_of(self, low: NDArray, high: NDArray) -> NDArray:
        """Return the depth of the plane of the glass in a window of the picture [m]."""
        normal = self.X_CM[:3, 2]
        across, down, level = np.linalg.solve(self.K.T, normal) / (normal @ self.X_CM[:3, 3])
        u, v = np.arange(low[0], high[0]) + 0.5, np.arange(low[1], high[1]) + 0.5
        found = np.empty((len(v), len(u)), np.float32)  # one large array: pictures have no room
        np.add(across * u, (down * v + level)[:, None], out=found, casting="same_kind")
        np.maximum(found, 1e-6, out=found)
        return np.divide(1.0, found, out=found)


def _from_plane(K: NDArray, X_CM: NDArray) -> NDArray:
    """Return the homography from the plane z = 0 of M into a camera's picture. Shape (3, 3)."""
    return K @ X_CM[:3, [0, 1, 3]]


def _moved(shift: NDArray) -> NDArray:
    """Return the homography that moves pixels. Shape (3, 3)."""
    H = np.eye(3)
    H[:2, 2] = shift
    return H


def _clipped(polygon: NDArray, row: NDArray) -> NDArray:
    """Return the part of a convex polygon where row . (x, y, 1) is not negative. Shape (k, 2)."""
    height = polygon @ row[:2] + row[2]
    kept = []
    for k in range(len(polygon)):
        start, end = height[k - 1], height[k]
        if (start < 0.0) != (end < 0.0):
            share = start / (start - end)
            kept.append(polygon[k - 1] + share * (polygon[k] - polygon[k - 1]))
        if end >= 0.0:
            kept.append(polygon[k])
    return np.reshape(kept, (-1, 2))
