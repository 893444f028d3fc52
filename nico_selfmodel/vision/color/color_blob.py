"""The largest patch of one colour, as the thesis finds it (section 7.1.1.1)."""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.arrays import read_only
from nico_selfmodel.vision.color.color_model import ColorModel
from nico_selfmodel.vision.images.image_array import as_color, detectable
from nico_selfmodel.vision.images.not_seen import NotSeen

_PASSES = 10
_MOST_PATCHES = 1000
_BAND = 100  # rows
_LEAN = 0.1  # towards the colour, where the neighbours are divided
_RIVAL = 0.7  # of the largest patch: a second one of this size might be meant as well
_NEIGHBOURS = np.array([[1.0, 1, 1], [1, 0, 1], [1, 1, 1]], dtype=np.float32) / 8.0


@dataclass(frozen=True, eq=False)
class ColorBlob:
    """A patch of colour."""

    center: NDArray
    """The point that counts, by `ColorModel.center` [px]. Shape (2,)."""
    centroid: NDArray
    """Mean of its pixels [px]. Shape (2,)."""
    box: tuple[int, int, int, int]
    """First column, first row, width and height of the bounding box [px]."""
    area_px: int
    """Number of its pixels."""
    labels: NDArray
    """Number of the patch that each pixel of the image belongs to. Shape (h, w)."""
    label: int
    """The number of this one."""
    touches_border: bool
    """True if it goes on outside the image, so that its centre is somewhere else."""

    @property
    def mask(self) -> NDArray:
        """Its pixels. Booleans, shape (h, w)."""
        return self.labels == self.label


def find_color_blob(
    image: NDArray, model: ColorModel, *, mask: NDArray | None = None
) -> ColorBlob | NotSeen:
    """Find the largest patch of a colour.

    Thresholds, blur, relaxation labelling (see `color_mask`), then the largest connected patch.

    Args:
        image: BGR, 8 bits. Shape (h, w, 3).
        mask: What `color_mask` returned of them, where it is at hand. Shape (h, w).

    Returns:
        The patch; or why none is vouched for: nothing of the colour, too small, cut by the border
        of the image, or a second patch of nearly the same size.

    Raises:
        ValueError: If the image has another shape or type.
    """
    blobs = _blobs(color_mask(image, model) if mask is None else mask, model)
    if not blobs:
        return NotSeen("no pixels of the colour")
    blob = blobs[0]
    if blob.area_px < model.least_area_px:
        return NotSeen(
            f"the largest patch of the colour has {blob.area_px} pixels, fewer than "
            f"{model.least_area_px:g}"
        )
    if len(blobs) > 1 and blobs[1].area_px >= _RIVAL * blob.area_px:
        u, v = blobs[1].centroid
        return NotSeen(
            f"two patches of nearly the same size: {blob.area_px} pixels at"
            f" ({blob.centroid[0]:.0f}, {blob.centroid[1]:.0f}) and {blobs[1].area_px} at"
            f" ({u:.0f}, {v:.0f})"
        )
    if blob.touches_border:
        return NotSeen("the patch is cut by the border of the image: its centre is not known")
    return blob


def color_blobs(image: NDArray, model: ColorModel) -> tuple[ColorBlob, ...]:
    """Return the patches of a colour, the largest first, however small; a thousand at most.

    Args:
        image: BGR, 8 bits. Shape (h, w, 3).

    Raises:
        ValueError: If the image has another shape or type.
    """
    return _blobs(color_mask(image, model), model)


def _blobs(mask: NDArray, model: ColorModel) -> tuple[ColorBlob, ...]:
    count, labels, table, centroids = cv2.connectedComponentsWithStats(
        mask.astype(np.uint8), connectivity=8
    )
    labels = read_only(labels)
    areas = table[1:count, cv2.CC_STAT_AREA]
    order = (1 + np.argsort(-areas, kind="stable")[:_MOST_PATCHES]).tolist()
    return tuple(_blob(labels, k, table[k], centroids[k], model) for k in order)


def color_mask(image: NDArray, model: ColorModel) -> NDArray:
    """Label the pixels of a colour.

    The pixels within the thresholds are blurred into probabilities p, which the neighbours then
    settle by relaxation labelling: with s = 2 m - 1 + 0.1, where m is the mean probability of the
    eight neighbours,

        p <- p (1 + s) / (p (1 + s) + (1 - p) (1 - s)),

    ten times. A pixel is drawn to where its neighbours lean. The 0.1 settles a tie for the colour,
    as the thesis' rule does (on if three or more of six neighbours are on): gaps and small
    highlights fill, single pixels vanish, and an outline grows by about a fifth of a pixel, alike
    on all sides.

    Args:
        image: BGR, 8 bits. Shape (h, w, 3).

    Returns:
        True where p > 1/2. Shape (h, w).

    Raises:
        ValueError: If the image has another shape or type.
    """
    detectable(image)
    matches = model.matches(as_color(image))
    mask = np.zeros(matches.shape, dtype=bool)
    rows, columns = np.flatnonzero(matches.any(axis=1)), np.flatnonzero(matches.any(axis=0))
    if not rows.size:
        return mask
    # What lies further from every match than blur and passes reach stays off.
    reach = int(np.ceil(4.0 * model.blur_px)) + _PASSES + 1
    box = tuple(slice(max(i[0] - reach, 0), i[-1] + reach + 1) for i in (rows, columns))
    mask[box] = _relaxed(matches[box].astype(np.float32), model.blur_px) > 0.5
    return mask


def _relaxed(p: NDArray, blur_px: float) -> NDArray:
    """Return the probabilities after the blur and all passes. Shape (h, w)."""
    if blur_px > 0.0:
        p = cv2.GaussianBlur(p, (0, 0), blur_px)
    # In bands, which the processor's cache holds; a pass reaches one row into the next band.
    relaxed = np.zeros_like(p)
    for first in range(0, len(p), _BAND):
        start = max(first - _PASSES, 0)
        band = p[start : first + _BAND + _PASSES]
        if band.any():  # else it stays as it is
            relaxed[first : first + _BAND] = _passes(band.copy())[first - start :][:_BAND]
    return relaxed


def _passes(p: NDArray) -> NDArray:
    """Return the probabilities after all passes. Shape (h, w)."""
    for _ in range(_PASSES):
        support = cv2.filter2D(p, -1, _NEIGHBOURS, borderType=cv2.BORDER_REPLICATE)
        support *= 2.0
        support += _LEAN - 1.0
        np.clip(support, -1.0, 1.0, out=support)
        both = p * support  # p (1 + s) + (1 - p) (1 - s) = 1 - s + 2 p s
        p += both
        both *= 2.0
        both += 1.0
        both -= support
        # A pixel whose neighbours all say the opposite of it has nothing left to go by: they win.
        lost = both <= 1e-6
        np.maximum(both, 1e-6, out=both)
        p /= both
        p[lost] = 0.5 * (1.0 + support[lost])
    return p


def _blob(
    labels: NDArray, label: int, row: NDArray, centroid: NDArray, model: ColorModel
) -> ColorBlob:
    left, top, width, height = (int(value) for value in row[:4])
    middle = [left + 0.5 * (width - 1), top + 0.5 * (height - 1)]
    rows, columns = labels.shape
    cut = left == 0 or top == 0 or left + width == columns or top + height == rows
    centroid = read_only(centroid)
    return ColorBlob(
        center=read_only(middle) if model.center == "box" else centroid,
        centroid=centroid,
        box=(left, top, width, height),
        area_px=int(row[cv2.CC_STAT_AREA]),
        labels=labels,
        label=label,
        touches_border=cut,
    )
