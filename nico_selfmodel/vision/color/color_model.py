"""What a colour is: the thresholds that tell a coloured patch from everything else."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray

from nico_selfmodel.errors import DataError
from nico_selfmodel.files.whole import write_whole
from nico_selfmodel.files.yaml_mapping import (
    check_keys,
    number_value,
    read_yaml_mapping,
    text_value,
)
from nico_selfmodel.names import shown
from nico_selfmodel.vision.images.image_array import as_color

FORMAT = "nico-color/1"
CHANNELS = ("red", "green", "blue")
_BAND = 256  # rows of an image that are looked at at once
_LARGEST_BLUR = 50.0  # [px]
_GREYISH = 0.15  # a saturation that light alone gives to white paper
_SPREAD_DEG = 40.0  # of hue, beyond which clicks were on different colours


@dataclass(frozen=True)
class ColorModel:
    """Thresholds for one colour (thesis section 7.1.1.1), and what a patch of it must be like.

    A pixel has the colour if its dominant channel exceeds each of the other two by so much (for
    red: R-G and R-B), and its hue and saturation lie in their ranges.
    """

    dominant: str
    """The channel that the others are subtracted from: red, green or blue."""
    excess: tuple[float, float]
    """Least differences to the other two channels, in the order red, green, blue [grey levels]."""
    hue_deg: float
    """Middle of the range of hue: 0 is red, 120 green, 240 blue [deg]."""
    hue_range_deg: float
    """How far hue may be from it, either way round [deg]."""
    saturation: float
    """Least saturation, 0 (grey) to 1."""
    least_area_px: float = 30.0
    """Smaller patches are not seen [px]."""
    blur_px: float = 1.0
    """Standard deviation of the blur before the labelling [px]."""
    center: str = "box"
    """Which point of the patch counts: `box`, the middle of its bounding box as in the thesis, or
    `centroid`, the mean of its pixels."""

    def __post_init__(self) -> None:
        """Refuse thresholds that mean nothing."""
        if self.dominant not in CHANNELS:
            raise ValueError(f"dominant must be red, green or blue, got {self.dominant!r}")
        if self.center not in ("box", "centroid"):
            raise ValueError(f"center must be box or centroid, got {self.center!r}")
        if not 0.0 <= self.saturation <= 1.0:
            raise ValueError(f"saturation must be between 0 and 1, got {self.saturation}")
        if not 0.0 < self.hue_range_deg <= 180.0:
            raise ValueError(f"hue_range_deg must be in (0, 180], got {self.hue_range_deg}")
        if not all(abs(least) <= 255.0 for least in self.excess):
            raise ValueError(f"differences of grey levels are at most 255, got {self.excess}")
        if not abs(self.hue_deg) <= 360.0:
            raise ValueError(f"hue_deg must lie between -360 and 360, got {self.hue_deg}")
        if not (self.least_area_px >= 1.0 and 0.0 <= self.blur_px <= _LARGEST_BLUR):
            raise ValueError(
                f"least_area_px must be at least 1 and blur_px between 0 and {_LARGEST_BLUR:g},"
                f" got {self.least_area_px} and {self.blur_px}"
            )

    def matches(self, image: NDArray) -> NDArray:
        """Return which pixels have the colour, before blur and labelling.

        Args:
            image: BGR, 8 bits. Shape (h, w, 3).

        Returns:
            Booleans. Shape (h, w).
        """
        image = as_color(image)
        found = np.zeros(image.shape[:2], dtype=bool)
        # In bands: its measures take twenty times the room of an image.
        for first in range(0, len(image), _BAND):
            band = slice(first, first + _BAND)
            found[band] = self._matches(image[band])
        return found

    def _matches(self, image: NDArray) -> NDArray:
        dominant, others, hue, saturation = _measures(image, self.dominant)
        near = np.abs(_turned(hue - self.hue_deg)) <= self.hue_range_deg
        more = [dominant - other >= least for other, least in zip(others, self.excess, strict=True)]
        return near & more[0] & more[1] & (saturation >= self.saturation)

    @classmethod
    def from_clicks(
        cls, images: Sequence[NDArray], points: Sequence[ArrayLike], radius: float = 3.0
    ) -> "ColorModel":
        """Learn the thresholds from pixels that a person pointed at.

        All pixels within `radius` of the clicks count; the outermost 5 % are left out of account,
        and the thresholds leave room around the others.

        Args:
            images: BGR, 8 bits.
            points: For each image the clicked pixels, shape (n, 2), possibly none.
            radius: Of the disk around each click [px].

        Raises:
            ValueError: If there are no clicks, or one lies outside its image.
            DataError: If the pixels are grey, over-exposed, or of different colours.
        """
        bgr = _clicked(images, points, radius)
        dominant = CHANNELS[int(np.argmax(bgr.reshape(-1, 3).mean(axis=0)[::-1]))]
        top, others, hue, saturation = _measures(bgr, dominant)
        if np.median(saturation) < _GREYISH:
            raise DataError(
                f"the clicked pixels are nearly grey (saturation {np.median(saturation):.2f}, at"
                f" least {_GREYISH} is needed): over-exposed, too dark, or not a strong colour"
            )
        turn = np.exp(1j * np.radians(hue[saturation >= _GREYISH]))
        middle = float(np.degrees(np.angle(turn.mean()))) % 360.0
        spread = float(np.percentile(np.abs(_turned(hue - middle)), 95))
        if spread > _SPREAD_DEG:
            raise DataError(
                f"the clicked pixels have different colours (hue {middle:.0f} ± {spread:.0f} deg):"
                " click on one colour only"
            )
        excess = [float(np.percentile(top - other, 5)) for other in others]
        return cls(
            dominant=dominant,
            excess=(_with_room(excess[0]), _with_room(excess[1])),
            hue_deg=round(middle, 1),
            hue_range_deg=round(1.5 * spread + 8.0, 1),
            saturation=round(0.7 * float(np.percentile(saturation, 5)), 3),
        )

    def save(self, path: str | Path) -> None:
        """Write the thresholds as YAML, whole or not at all.

        Args:
            path: Where to write; its folder must exist.

        Raises:
            OSError: If the folder is missing or cannot be written to.
        """
        others = [name for name in CHANNELS if name != self.dominant]
        write_whole(
            path,
            f"format: {FORMAT}\n"
            "# A pixel has the colour if this channel exceeds the other two by so much, of 255,\n"
            f"dominant: {self.dominant}\n"
            f"over_{others[0]}: {self.excess[0]!r}\n"
            f"over_{others[1]}: {self.excess[1]!r}\n"
            "# its hue is near enough (0 red, 120 green, 240 blue)\n"
            f"hue_deg: {self.hue_deg!r}\n"
            f"hue_range_deg: {self.hue_range_deg!r}\n"
            "# and its saturation high enough (0 grey, 1 pure).\n"
            f"saturation: {self.saturation!r}\n"
            "# Smaller patches are not seen; the mask is blurred by so much before the labelling.\n"
            f"least_area_px: {self.least_area_px!r}\n"
            f"blur_px: {self.blur_px!r}\n"
            "# box: the middle of the bounding box; centroid: the mean of the pixels.\n"
            f"center: {self.center}\n",
        )

    @classmethod
    def load(cls, path: str | Path) -> "ColorModel":
        """Read a file that `save` wrote, or a person changed.

        Raises:
            DataError: If it cannot be read, is of another format, lacks a key, has one that nobody
                reads, or a value is out of range.
        """
        path = Path(path)
        content = read_yaml_mapping(path)
        if content.get("format") != FORMAT:
            raise DataError(
                f"{path}: 'format' must be {FORMAT}, got {shown(content.get('format'))}; make such"
                " a file with nico-selfmodel pick-color"
            )
        dominant = text_value(content, "dominant", str(path))
        if dominant not in CHANNELS:
            raise DataError(f"{path}: 'dominant' must be red, green or blue, got {shown(dominant)}")
        over = [f"over_{name}" for name in CHANNELS if name != dominant]
        needed = [*over, "hue_deg", "hue_range_deg", "saturation"]
        keys = [*needed, "least_area_px", "blur_px"]
        check_keys(content, ["format", "dominant", *keys, "center"], str(path))
        given = {key: number_value(content, key, str(path)) for key in keys}
        values = {key: value for key, value in given.items() if value is not None}
        for key in needed:
            if key not in values:
                raise DataError(f"{path}: key {key!r} is missing")
        excess = values.pop(over[0]), values.pop(over[1])
        center = text_value(content, "center", str(path), "box")
        try:
            return cls(dominant=dominant, excess=excess, center=center, **values)
        except ValueError as error:
            raise DataError(f"{path}: {error}") from None


def _measures(image: NDArray, dominant: str) -> tuple[NDArray, list[NDArray], NDArray, NDArray]:
    """Return the dominant channel, the other two, hue [deg] and saturation [1] of pixels."""
    levels = {name: image[..., 2 - i].astype(np.float32) for i, name in enumerate(CHANNELS)}
    hsv = cv2.cvtColor(image.astype(np.float32) / 255.0, cv2.COLOR_BGR2HSV)
    others = [levels[name] for name in CHANNELS if name != dominant]
    return levels[dominant], others, hsv[..., 0], hsv[..., 1]


def _turned(angle_deg: NDArray) -> NDArray:
    """Return angles in [-180, 180)."""
    return (angle_deg + 180.0) % 360.0 - 180.0


def _clicked(images: Sequence[NDArray], points: Sequence[ArrayLike], radius: float) -> NDArray:
    """Return the pixels around the clicks. Shape (n, 1, 3)."""
    if len(images) != len(points):
        raise ValueError(
            f"points must be given for each of {len(images)} images, got {len(points)}"
        )
    disks = []
    for image, clicks in zip(images, points, strict=True):
        height, width = image.shape[:2]
        for click in np.asarray(clicks, dtype=float).reshape(-1, 2):
            if not (-0.5 <= click[0] < width - 0.5 and -0.5 <= click[1] < height - 0.5):
                raise ValueError(
                    f"{click[0]:g},{click[1]:g} lies outside the image of {width}x{height} pixels"
                )
            reach = min(max(radius, 0.8), float(width + height))
            low = np.maximum(np.floor(click - reach), 0.0).astype(int)
            # Of a large image the part around the click alone.
            part = as_color(image)[
                low[1] : int(click[1] + reach) + 2, low[0] : int(click[0] + reach) + 2
            ]
            v, u = np.indices(part.shape[:2])
            away = np.hypot(u + low[0] - click[0], v + low[1] - click[1])
            disks.append(part[away <= reach])
    if not disks:
        raise ValueError("no pixel was clicked: at least one is needed")
    return np.concatenate(disks)[:, None]


def _with_room(excess: float) -> float:
    return round(excess - max(0.5 * abs(excess), 15.0), 1)
