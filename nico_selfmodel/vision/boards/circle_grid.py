"""Grids of dark circles, in rows or with every other row moved by half a step.

OpenCV says which circle is where. Its centre is then measured as the centroid of what is dark,
which no symmetric blur moves; the image of a circle is an ellipse whose centroid is not the image
of the centre (Heikkila, Silven 1997, section 2.2), and the difference is taken off as a
plane behind a round lens has it. A circle at the image's edge, or with glare on it, is not seen.
"""

from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.arrays import read_only
from nico_selfmodel.vision.boards.board_detection import BoardDetection, Ink, grid_points
from nico_selfmodel.vision.boards.corner_order import same_order
from nico_selfmodel.vision.boards.exact_corners import without_strays
from nico_selfmodel.vision.boards.stray_corners import BoardBehindLens
from nico_selfmodel.vision.images.image_array import detectable, reduced
from nico_selfmodel.vision.images.not_seen import NotSeen

METHOD = "findCirclesGrid"
_PASSES = 2
"""Times that circles are measured about where they were seen before."""
_SEARCHED = 2_500_000
"""Pixels of the copy of a large image in which circles are looked for."""
_REACH = 1.35
"""Radii up to which what is dark belongs to a circle."""
_LOST = 0.25
"""Share of the circles that may not be plain to see: of more, it is no grid that was found."""
_AROUND, _LEAST_AROUND = 3.0, 1.5
"""What must be seen around a circle at the image's edge: with 2 px it is 0.08 px off; and around
others: small ones are blurred less far than they are apart [px]."""
_NARROWEST = 2.0 * _LEAST_AROUND / (_REACH - 1.0)
"""Width of a circle with so much around it [px]."""
_ROUND = 48
"""Points on a circle."""
_STEEPEST = 0.3
"""Least contrast anywhere about a circle, of that in its middle: where light falls off by more than
that a plane is no good."""
_NOISE = 16.0
"""Of pixels of 2 grey levels, over a half squared, by which ink may follow light otherwise than as
a share of it."""
_UNEVEN = 0.15
"""What light around a circle, and ink in it, may differ from planes by, as a share of the
contrast."""
_CONTRAST = 15.0
"""Least difference of a circle and what is around it [grey levels]."""


@dataclass(frozen=True)
class CircleGrid:
    """Dark circles on a light plane."""

    columns: int
    """Circles in a row, at least 3."""
    rows: int
    """Rows, at least 3."""
    square: float
    """Distance of neighbours [m]; of an asymmetric grid, of its rows: half of that in a row."""
    diameter: float
    """Diameter of a circle [m]."""
    asymmetric: bool = False
    """Whether every other row is moved by half a step."""

    def __post_init__(self) -> None:
        """Refuse boards that cannot be."""
        if self.columns < 3 or self.rows < 3:
            raise ValueError(f"a grid has at least 3x3 circles, got {self}")
        nearest = self.square * (np.sqrt(2.0) if self.asymmetric else 1.0)
        if not 0.0 < self.diameter < nearest < np.inf:
            raise ValueError(
                "circles of a grid are smaller than their distance, got diameters of "
                f"{1e3 * self.diameter:g} mm every {1e3 * nearest:g} mm"
            )
        if self.asymmetric and self.rows % 2 == 0:
            raise ValueError(
                f"an asymmetric grid of an even number of rows looks the same after half a turn: "
                f"take an odd one, got {self}"
            )

    def __str__(self) -> str:
        kind = "asymmetric-circles" if self.asymmetric else "circles"
        return f"{kind}:{self.columns}x{self.rows}"

    @property
    def points(self) -> NDArray:
        """The centres, row by row, z = 0 [m]. Shape (P, 3)."""
        return grid_points(self.columns, self.rows, self.square, int(self.asymmetric))

    @property
    def ink(self) -> Ink:
        """What is printed."""
        centres = self.points[:, :2]
        radii = np.full((len(centres), 1), 0.5 * self.diameter)
        return Ink(np.zeros((0, 4)), np.hstack([centres, radii]))

    @property
    def facts(self) -> dict[str, Any]:
        """What `result.json` tells of the board."""
        return {"board": str(self), "square_mm": 1e3 * self.square, "tag_mm": 1e3 * self.diameter}

    def same_order(self, left: NDArray, right: NDArray) -> NDArray:
        """Return the right camera's circles in the order of the left camera's.

        A grid in rows looks the same after half a turn; cameras are taken to be rolled against each
        other by less than 90 degrees (45 for a square grid).
        """
        return right if self.asymmetric else same_order(left, right, self.columns, self.rows)

    def find(self, image: NDArray, window: int) -> BoardDetection | NotSeen:
        """Find all circles, as `AnyBoard.find`; `window` is not used.

        Raises:
            ValueError: If the image has another shape or type.
        """
        del window
        gray = detectable(image)
        rough = self._rough(gray)
        if rough is None:
            return NotSeen(f"{METHOD} found no {self} grid")
        size = (gray.shape[1], gray.shape[0])
        try:
            centres = without_strays(self.points[:, :2], self._centred(gray, rough), size)
        except ValueError:  # circles on one line have no homography
            return NotSeen(f"no {self} grid but scattered spots")
        lost = np.isnan(centres[:, 0])
        if lost.sum() > _LOST * len(lost):
            return NotSeen(self._why_lost(rough, lost))
        return BoardDetection(self, read_only(centres), METHOD, None)

    def _why_lost(self, rough: NDArray, lost: NDArray) -> str:
        """Say why too many circles are not seen. Shapes (P, 2) and (P,)."""
        wide = self._width_of(rough)
        if wide < _NARROWEST:
            return (
                f"a {self} grid whose circles are {wide:.0f} px wide, at least {_NARROWEST:.0f} px "
                "tell where their middles are: go nearer, or take larger pictures"
            )
        u, v = rough[lost].mean(axis=0)
        return (
            f"a {self} grid, but {int(lost.sum())} of its circles are not plain to see (about "
            f"{u:.0f}, {v:.0f}): the image's edge, glare, a shadow or dirt"
        )

    def _width_of(self, centres: NDArray) -> float:
        """Return how wide the smallest circles are about [px]. Shape (P, 2)."""
        seen, board = (
            np.linalg.norm(p[:, None] - p, axis=2) + np.diag(np.full(len(p), np.inf))
            for p in (centres, self.points[:, :2])
        )
        return float(self.diameter * (seen.min(axis=1) / board.min(axis=1)).min())

    def _rough(self, gray: NDArray) -> NDArray | None:
        """Return centres as OpenCV sees them; None where it sees no grid. Shape (P, 2)."""
        kind = cv2.CALIB_CB_ASYMMETRIC_GRID if self.asymmetric else cv2.CALIB_CB_SYMMETRIC_GRID
        copy, scale = reduced(gray, _SEARCHED)
        blobs = _blob_detector(copy.size / len(self.points))
        for flags in (kind, kind | cv2.CALIB_CB_CLUSTERING):
            size = (self.columns, self.rows)
            found, centres = cv2.findCirclesGrid(copy, size, flags=flags, blobDetector=blobs)
            if found:
                spots = centres.reshape(-1, 2).astype(float)
                return self._listed((spots + 0.5) * scale - 0.5)
        return None

    def _listed(self, centres: NDArray) -> NDArray:
        """Return centres in one order: columns turn into rows as u turns into v."""
        if self.asymmetric:
            return centres
        grid = centres.reshape(self.rows, self.columns, 2)
        along, down = grid[0, -1] - grid[0, 0], grid[-1, 0] - grid[0, 0]
        if along[0] * down[1] - along[1] * down[0] < 0.0:
            grid = grid[::-1]
        if (grid[0, -1] - grid[0, 0])[0] < 0.0:
            grid = grid[::-1, ::-1]
        return grid.reshape(-1, 2)

    def _centred(self, gray: NDArray, rough: NDArray) -> NDArray:
        """Return images of the centres, nan of circles that are not plain to see. (P, 2)."""
        centres, board = rough, self.points[:, :2]
        angle = np.linspace(0.0, 2.0 * np.pi, _ROUND, endpoint=False)
        circle = 0.5 * self.diameter * np.stack([np.cos(angle), np.sin(angle)], axis=1)
        shape = (len(board), _ROUND, 2)
        for _ in range(_PASSES):
            if np.isnan(centres[:, 0]).sum() > _LOST * len(centres):
                break
            seen = BoardBehindLens.of_seen(board, centres, (gray.shape[1], gray.shape[0]))
            middles = seen.pixels_of(board)
            outlines, wide = (
                seen.pixels_of((board[:, None] + share * circle).reshape(-1, 2)).reshape(shape)
                for share in (1.0, _REACH)
            )
            dark = [_dark_centroid(gray, *both) for both in zip(wide, outlines, strict=True)]
            # The middle of what a circle looks like is not where its middle is.
            aside = np.array([_centroid(outline) for outline in outlines]) - middles
            centres = np.array(dark) - aside
        return centres


def _blob_detector(largest: float) -> cv2.SimpleBlobDetector:
    """Return OpenCV's detector of spots, of up to an area [px]; its own end at 5000."""
    parameters = cv2.SimpleBlobDetector.Params()
    parameters.maxArea = max(float(largest), parameters.maxArea)
    return cv2.SimpleBlobDetector.create(parameters)


def _centroid(outline: NDArray) -> NDArray:
    """Return the centroid of a polygon's area. Shape (n, 2) -> (2,)."""
    start, end = outline, np.roll(outline, -1, axis=0)
    area = start[:, 0] * end[:, 1] - end[:, 0] * start[:, 1]
    return np.asarray(((start + end) * area[:, None]).sum(axis=0) / (3.0 * area.sum()))


def _dark_centroid(gray: NDArray, wide: NDArray, outline: NDArray) -> NDArray:
    """Return the centroid of what is dark within an outline; nan where it is not plain to see.

    What is light around it may fall off in any direction: it is taken as a plane. Where it is none,
    as at the edge of a shadow, nothing is told.
    """
    middle, size = outline.mean(axis=0), np.array(gray.shape[::-1])
    room, reach = np.minimum(middle, size - 1.0 - middle), np.abs(wide - middle).max(axis=0)
    fits = min(1.0, float((room / reach).min()))
    around = float((fits * reach - np.abs(outline - middle).max(axis=0)).min())
    if around < (_AROUND if fits < 1.0 else _LEAST_AROUND):
        return np.full(2, np.nan)
    wide = middle + fits * (wide - middle)
    low = np.maximum(np.floor(wide.min(axis=0)).astype(int) - 1, 0)
    high = np.minimum(np.ceil(wide.max(axis=0)).astype(int) + 2, size)
    part = gray[low[1] : high[1], low[0] : high[0]].astype(float)
    u, v = np.meshgrid(np.arange(part.shape[1]), np.arange(part.shape[0]))
    inside = np.zeros(part.shape, np.uint8)
    cv2.fillPoly(inside, [np.rint((wide - low) * 16).astype(np.int32)], 1, shift=4)
    core = np.zeros(part.shape, np.uint8)
    cv2.fillPoly(
        core, [np.rint((outline * 0.5 + middle * 0.5 - low) * 16).astype(np.int32)], 1, shift=4
    )
    rim = cv2.morphologyEx(inside, cv2.MORPH_GRADIENT, np.ones((3, 3), np.uint8)) > 0
    columns = np.stack([np.ones(part.shape), u, v], axis=2)
    plane, *_ = np.linalg.lstsq(columns[rim], part[rim], rcond=None)
    light = columns @ plane
    inner = core > 0
    if not inner.any():
        return np.full(2, np.nan)
    dark, ink = light - part, _ink(light, light[inner], part[inner])
    contrast = float(dark[inner].mean())
    uneven = max(float(np.std(dark[rim])), float(np.std((part - ink)[inner])))
    if contrast < _CONTRAST or uneven > _UNEVEN * contrast:
        return np.full(2, np.nan)
    # Of a pixel at the outline a part is dark, as light falls there.
    weights = dark / np.maximum(light - ink, _STEEPEST * contrast) * (inside > 0)
    total = weights.sum()
    return np.array([(weights * u).sum(), (weights * v).sum()]) / total + low


def _ink(light: NDArray, own: NDArray, seen: NDArray) -> NDArray:
    """Return what ink looks like where it is lit as its surroundings are. Shape (h, w).

    Light falls off by a share of what is seen, or is added to it: with s what ink follows light by,
    s = ink / light of the one, 1 of the other, and what is seen of it tells, where that tells
    anything.

    Args:
        light: Around a circle, continued into it. Shape (h, w).
        own: The same where there is ink alone. Shape (n,).
        seen: What is seen there. Shape (n,).
    """
    bright, black = own.mean(), seen.mean()
    share, off = black / max(bright, 1.0), own - bright
    follows = (_NOISE * share + off @ (seen - black)) / (_NOISE + off @ off)
    return np.asarray(black + follows * (light - bright))
