"""From the picture of a pinhole renderer to that of a camera with a lens."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property

import cv2
import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.arrays import read_only
from nico_selfmodel.errors import ModelError
from nico_selfmodel.model.cameras.camera import Camera
from nico_selfmodel.vision.images.image_array import averaged

_MARGIN = 2
"""Rendered pixels around what the lens sees, for the interpolation."""
_LARGEST = 8192
"""Longest side of a picture to render; a wider lens has to be cut [px]."""
_CELL = 4
"""Pixels of the camera between places that tell which of them a part of a picture reaches."""
_WIDEST = 2.5
"""Rays flatter than this X/Z are left black: a plane cannot show them [1]."""
_NOWHERE = 1e4
"""X/Z and Y/Z of samples without a ray [1]."""

Window = tuple[int, int, int, int]
"""First column and row of a part of a rendered picture, and the first ones beyond it [px]."""


@dataclass(frozen=True, eq=False)
class Region:
    """Some of a camera's pixels."""

    pixels: tuple[slice, slice]
    """Rows and columns of the camera's picture."""
    samples: tuple[slice, slice]
    """The same of the supersampled one."""


@dataclass(frozen=True, eq=False)
class LensWarp:
    """What a pinhole renderer must render, and how the lens bends it.

    The pinhole looks along the camera's axes and is padded so that it sees all that the lens sees.
    Its matrix counts from the edge of the first pixel, as Drake's and OpenGL's do; the picture
    that comes out counts from its centre, as OpenCV's and `Camera` do.
    """

    camera: Camera
    """The camera to imitate."""
    supersample: int
    """Rendered pixels along the side of one of the camera's, where the lens does not bend."""
    render_size: tuple[int, int]
    """Width and height to render [px]."""
    render_K: NDArray
    """Intrinsic matrix to render with, from the edge of the first pixel [px]. Shape (3, 3)."""
    dark: NDArray
    """Pixels of the camera that no ray reaches. Boolean, shape (height, width)."""
    maps: tuple[NDArray, NDArray]
    """OpenCV's fixed-point maps from the supersampled camera into the rendered picture."""
    rays: NDArray
    """X/Z, Y/Z of the samples, far outside where there is no ray. 32 bits, shape
    (height s, width s, 2)."""
    _plains: dict[tuple[int, ...], NDArray] = field(default_factory=dict)

    @classmethod
    def from_camera(cls, camera: Camera, supersample: int = 2) -> "LensWarp":
        """Prepare the maps, by Newton for every sample, once.

        Args:
            camera: Intrinsics and distortion; its pose does not matter here.
            supersample: Samples along each side of a pixel, which are averaged by area.

        Raises:
            ValueError: If `supersample` is less than 1.
            ModelError: If the lens sees so wide that no reasonable picture holds it.
        """
        if supersample < 1:
            raise ValueError(f"supersample must be at least 1, got {supersample}")
        if max(camera.image_size) * supersample > _LARGEST:
            raise ModelError(_too_large(supersample * np.array(camera.image_size)))
        ideal = _ideal_of_samples(camera, supersample)
        ideal[np.abs(ideal).max(axis=2) > _WIDEST] = np.nan
        focal = supersample * np.array([camera.fx, camera.fy])
        low = np.floor(np.nanmin(ideal, axis=(0, 1)) * focal) - _MARGIN
        high = np.ceil(np.nanmax(ideal, axis=(0, 1)) * focal) + _MARGIN
        width, height = (int(side) for side in high - low)
        if max(width, height) > _LARGEST:
            raise ModelError(_too_large((width, height)))
        K = read_only([[focal[0], 0.0, -low[0]], [0.0, focal[1], -low[1]], [0.0, 0.0, 1.0]])
        # From the edge of the first pixel to its centre, which is what cv2.remap counts from.
        places = (ideal * focal - low - 0.5).astype(np.float32)
        places[np.isnan(places)] = -_MARGIN * 10.0
        rays = np.nan_to_num(ideal.astype(np.float32), nan=_NOWHERE)
        maps = cv2.convertMaps(places[..., 0], places[..., 1], cv2.CV_16SC2)
        blocks = np.isnan(ideal[..., 0]).reshape(
            camera.image_size[1], supersample, camera.image_size[0], supersample
        )
        dark = read_only(blocks.all(axis=(1, 3)))
        return cls(camera, supersample, (width, height), K, dark, (maps[0], maps[1]), rays)

    def apply(self, rendered: NDArray) -> NDArray:
        """Bend a rendered picture.

        Args:
            rendered: 8 bits, rendered with `render_K`. Shape (h, w) or (h, w, channels).

        Returns:
            The camera's picture. Shape (height, width) or (height, width, channels).

        Raises:
            ValueError: If the picture has another size.
        """
        if rendered.shape[1::-1] != self.render_size:
            raise ValueError(
                f"the picture must be {self.render_size} wide and high, got {rendered.shape[1::-1]}"
            )
        bent = cv2.remap(rendered, *self.maps, cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT)
        return self._averaged(bent, self.camera.image_size)

    def nearest(self, rendered: NDArray, outside: float) -> NDArray:
        """Bend a rendered picture of what cannot be averaged, as labels or distances.

        Args:
            rendered: Rendered with `render_K`. Shape (h, w).
            outside: What pixels hold that no ray reaches.

        Returns:
            The value of one sample in the middle of each pixel. Shape (height, width).
        """
        s = self.supersample
        places = np.ascontiguousarray(self.maps[0][s // 2 :: s, s // 2 :: s])
        bent = cv2.remap(
            np.ascontiguousarray(rendered),
            places,
            np.zeros(places.shape[:2], np.uint16),
            cv2.INTER_NEAREST,
            borderMode=cv2.BORDER_CONSTANT,
            borderValue=(outside,),
        )
        return np.where(self.dark, np.asarray(outside, rendered.dtype), bent)

    def apply_to_part(
        self,
        part: NDArray,
        window: Window,
        color: NDArray,
        H: NDArray | None = None,
    ) -> NDArray:
        """Bend a rendered picture of which only a part is not plain.

        Args:
            part: That part, 8 bits. Shape (h, w, channels).
            window: Its first column and row in the whole picture, and the first ones beyond it.
            color: Of all the rest. Shape (channels,).
            H: Where it was rendered by a turned camera: from X/Z, Y/Z, 1 to places in it, from the
                edge of its first pixel. Shape (3, 3).

        Returns:
            What `apply` makes of the whole picture. Shape (height, width, channels).
        """
        picture = self.plain(color).copy()
        region = self.region(window)
        if region is None:
            return picture
        if H is None:
            fine = region.samples
            places = self.maps[0][fine] - np.array(window[:2], dtype=np.int16), self.maps[1][fine]
        else:
            places = self._places(region, H)
        picture[region.pixels] = self._bent(part, places, region, color)
        return picture

    def region(self, window: Window) -> "Region | None":
        """Return the camera's pixels that a part of the rendered picture may reach, None if none.

        Args:
            window: The part's first column and row, and the first ones beyond it.
        """
        rows, columns = self._reached(window)
        return self._region(rows, columns) if rows.stop and columns.stop else None

    def region_in(self, way: NDArray, angle: float) -> "tuple[Region, NDArray] | None":
        """Return the camera's pixels that look into a cone.

        Args:
            way: Along its axis, of length 1. Shape (3,).
            angle: From the axis to its side [rad].

        Returns:
            A region around these pixels, and which of it they are, boolean of shape (rows,
            columns); None where there is none.
        """
        least = np.cos(angle)
        inside = _along(self.rays[:: _CELL * self.supersample, :: _CELL * self.supersample], way)
        inside = inside >= np.cos(min(angle + 2.0 * _CELL / self.camera.fx, np.pi))
        (rows, columns), size = np.nonzero(inside), self.camera.image_size
        if not len(rows):
            return None
        region = self._region(
            *(
                slice(max(_CELL * (int(at.min()) - 1), 0), min(_CELL * (int(at.max()) + 1), n))
                for at, n in ((rows, size[1]), (columns, size[0]))
            )
        )
        s = self.supersample
        shown = _along(self.rays[region.samples][s // 2 :: s, s // 2 :: s], way) >= least
        return (region, shown) if shown.any() else None

    def rays_of(self, region: "Region", shown: NDArray) -> NDArray:
        """Return X/Z, Y/Z of all samples of the pixels that others of a region lie between.

        Samples without a ray stay black, and tell a camera nothing of where to turn.

        Args:
            shown: The pixels. Boolean, shape (rows, columns).

        Returns:
            Shape (N, 2); of none where no pixel has a ray.
        """
        s, (whole, lit) = self.supersample, self._lit
        within = cv2.erode(
            (shown & whole[region.pixels]).astype(np.uint8),
            np.ones((3, 3), np.uint8),
            borderType=cv2.BORDER_CONSTANT,
            borderValue=(0.0,),
        )
        sides = shown & (within == 0)
        wanted = sides.repeat(s, axis=0).repeat(s, axis=1) & lit[region.samples]
        return self.rays[region.samples][wanted].astype(float)

    def _region(self, rows: slice, columns: slice) -> "Region":
        s = self.supersample
        fine = (slice(s * rows.start, s * rows.stop), slice(s * columns.start, s * columns.stop))
        return Region((rows, columns), fine)

    def bend_region(self, part: NDArray, region: "Region", H: NDArray) -> NDArray:
        """Bend what a turned camera rendered of a region.

        Args:
            part: All of the region, 8 bits. Shape (h, w, channels).
            H: From X/Z, Y/Z, 1 to places from the edge of its first pixel. Shape (3, 3).

        Returns:
            These pixels. Shape (rows, columns, channels).
        """
        return self._bent(part, self._places(region, H), region, np.zeros(part.shape[2]))

    def _bent(
        self, part: NDArray, places: tuple[NDArray, NDArray], region: "Region", color: NDArray
    ) -> NDArray:
        """Return the pixels of a region from places in a part, beyond which there is one colour."""
        bent = cv2.remap(
            part,
            *places,
            cv2.INTER_LINEAR,
            borderMode=cv2.BORDER_CONSTANT,
            borderValue=color.tolist(),
        )
        outside = self._outside[region.samples]
        if outside.any():  # where no ray falls nothing has a colour
            bent[outside] = 0
        rows, columns = region.pixels
        return self._averaged(bent, (columns.stop - columns.start, rows.stop - rows.start))

    def _places(self, region: "Region", H: NDArray) -> tuple[NDArray, NDArray]:
        """Return where in a turned camera's picture samples are, as `cv2.remap` takes it."""
        to_centers = np.array([[1.0, 0.0, -0.5], [0.0, 1.0, -0.5], [0.0, 0.0, 1.0]])
        places = cv2.perspectiveTransform(self.rays[region.samples], to_centers @ H)
        maps = cv2.convertMaps(places[..., 0], places[..., 1], cv2.CV_16SC2)
        return maps[0], maps[1]

    def _averaged(self, bent: NDArray, size: tuple[int, int]) -> NDArray:
        if self.supersample == 1:
            return bent
        return averaged(bent, size)

    def plain(self, color: NDArray) -> NDArray:
        """Return what becomes of a plain picture; the same array again for the same colour.

        Args:
            color: 8 bits. Shape (channels,).
        """
        key = tuple(color.tolist())
        if key not in self._plains:
            width, height = self.render_size
            rendered = np.full((height, width, len(key)), color, dtype=np.uint8)
            self._plains.clear()
            self._plains[key] = read_only(self.apply(rendered))
        return self._plains[key]

    @cached_property
    def _outside(self) -> NDArray:
        """Samples that nothing is rendered for. Boolean, shape (height s, width s)."""
        places = self.maps[0]
        return np.any((places < 0) | (places >= np.array(self.render_size)), axis=2)

    @cached_property
    def _lit(self) -> tuple[NDArray, NDArray]:
        """Pixels all of whose samples have a ray, and samples that have one. Boolean."""
        s, lit = self.supersample, np.all(self.rays < _NOWHERE, axis=2)
        width, height = self.camera.image_size
        return lit.reshape(height, s, width, s).all(axis=(1, 3)), lit

    @cached_property
    def _cells(self) -> tuple[NDArray, NDArray]:
        """Least and largest column and row that a cell's samples see. Shapes (rows, columns, 2)."""
        step, places = _CELL * self.supersample, self.maps[0]
        last = [np.minimum(np.arange(0, n + step, step), n - 1) for n in places.shape[:2]]
        corners = places[np.ix_(*last)].astype(int)
        four = [corners[a : -1 + a or None, b : -1 + b or None] for a in (0, 1) for b in (0, 1)]
        return np.min(four, axis=0), np.max(four, axis=0)

    def _reached(self, window: Window) -> tuple[slice, slice]:
        """Return rows and columns of the camera's pixels that a part of the picture may reach."""
        low, high = self._cells
        inside = (high >= np.array(window[:2]) - _MARGIN) & (low < np.array(window[2:]) + _MARGIN)
        inside = np.all(inside, axis=2)
        found = []
        for axis, size in ((1, self.camera.image_size[1]), (0, self.camera.image_size[0])):
            at = np.flatnonzero(np.any(inside, axis=axis))
            first, last = (at[0], at[-1] + 1) if len(at) else (0, 0)
            found.append(slice(int(_CELL * first), int(min(_CELL * last, size))))
        return found[0], found[1]


def _along(rays: NDArray, way: NDArray) -> NDArray:
    """Return cosines of the angles between rays X/Z, Y/Z and a direction. (h, w, 2) -> (h, w)."""
    x, y = rays[..., 0], rays[..., 1]
    return (x * way[0] + y * way[1] + way[2]) / np.sqrt(x * x + y * y + 1.0)


def _too_large(size: Sequence[int] | NDArray) -> str:
    return (
        f"the lens asks for a picture of {size[0]} x {size[1]} px, at most {_LARGEST} are "
        "rendered: lower the supersampling or check the camera"
    )


def _ideal_of_samples(camera: Camera, supersample: int) -> NDArray:
    """Return X/Z, Y/Z of samples spread evenly over each pixel, nan where there is no ray.

    Shape (height * supersample, width * supersample, 2).
    """
    width, height = camera.image_size
    u, v = ((np.arange(size * supersample) + 0.5) / supersample - 0.5 for size in (width, height))
    pixels = np.stack(np.meshgrid(u, v), axis=-1).reshape(-1, 2)
    ideal = np.full(pixels.shape, np.nan)
    seen = camera.has_rays(pixels)
    ideal[seen] = camera.undistort(pixels[seen])
    return ideal.reshape(height * supersample, width * supersample, 2)
