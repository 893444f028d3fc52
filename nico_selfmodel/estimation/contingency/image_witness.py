"""What moves when I do: a mirror, a picture of me, or somebody who imitates me at once.

Timing cannot tell them (`contingency`), geometry can: a mirror's image lies behind it, each of its
points as far as the point itself is before it, and is turned round; a picture lies in its screen,
whichever camera looks; and whoever imitates is somewhere else, and not turned round.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.dataset.dataset import Dataset
from nico_selfmodel.dataset.joint_info import JointInfo
from nico_selfmodel.errors import DataError, EstimationError
from nico_selfmodel.estimation.mirrors.mirror import calibrate_mirrors
from nico_selfmodel.geometry.plane import Plane
from nico_selfmodel.model.self_model import SelfModel
from nico_selfmodel.optimization.chi_square import chi_square_tail

MIRROR, PICTURE, ANOTHER = "a mirror", "a picture", "another"
CANNOT_TELL = "cannot tell"
FEWEST = 5
"""Looks at an image of the hand that a verdict takes."""
_PIXEL_SIGMA = 0.3
"""Of a marker's pixels, with what the cameras are learned wrongly by [px]."""
_BY_CHANCE = 1e-3
"""A picture is taken for something deeper this often."""
_MOST_PX = 5.0
"""Mean error of a hand in a mirror whose plane explains it; in a screen it is tens of pixels
[px]."""
_POWER = 60.0
"""Squares that the own hand's distances from a plane must have, in units of the pictures' noise,
for a picture to be told from what is deep."""
_NAME = "seen"


@dataclass(frozen=True, eq=False)
class HandImages:
    """What was seen of a hand that is not the own hand itself."""

    joints: tuple[JointInfo, ...]
    """Of the own arm."""
    marker: str
    """What the hand carries."""
    readings: NDArray
    """Of the own encoders in each look [encoder units]. Shape (N, n)."""
    pixels: NDArray
    """Left u, v, right u, v of the marker [px]. Shape (N, 4)."""
    mirrored: NDArray
    """Whether it was turned round, as a mirror does. Shape (N,)."""


@dataclass(frozen=True)
class ImageVerdict:
    """What an image of oneself is, and by what."""

    verdict: str
    """`MIRROR`, `PICTURE`, `ANOTHER` or `CANNOT_TELL`."""
    looks: int
    """How often it was seen."""
    depth_mm: float
    """Root mean square distance of what was seen from a plane [mm]."""
    depth_sigma_mm: float
    """How much of that is the noise of the pictures [mm]."""
    hand_mm: float
    """The same of the own hand: how deep a mirror's image or another's hand would be [mm]."""
    mirror_px: float
    """Mean error of the hand as the best mirror would show it; nan where none fits [px]."""


def tell_image(seen: HandImages, model: SelfModel) -> ImageVerdict:
    """Say what an image of one's own hand is.

    Points that both cameras see lie in a plane where the chi-square of their distances from it is
    no rarer than one in a thousand; then it is a picture, if the own hand did not move in a plane
    itself. Otherwise it is a mirror where the image is turned round and a mirror's plane explains
    it; and another where it is not turned round.

    Raises:
        ModelError: If the model has no arm or no pair of cameras.
    """
    looks, turned = len(seen.pixels), int(np.sum(seen.mirrored))
    if looks < FEWEST:
        nan = float("nan")
        return ImageVerdict(CANNOT_TELL, looks, nan, nan, nan, nan)
    off, sigma = _off_plane(seen, model)
    p_WH = model.points(model.servos.to_joint(seen.readings))
    hand = Plane.from_points(p_WH).distance_to(p_WH)
    mirror_px = _mirror_error(seen, model) if turned == looks else float("nan")
    if chi_square_tail(float(np.sum((off / sigma) ** 2)), looks - 3) > _BY_CHANCE:
        deep = float(np.sum((hand / sigma) ** 2)) > _POWER
        verdict = PICTURE if deep else CANNOT_TELL
    elif mirror_px < _MOST_PX:
        verdict = MIRROR
    else:
        verdict = CANNOT_TELL if turned else ANOTHER
    depth, noise, own = (
        1e3 * float(np.sqrt(np.mean(np.square(each)))) for each in (off, sigma, hand)
    )
    return ImageVerdict(verdict, looks, depth, noise, own, mirror_px)


def _off_plane(seen: HandImages, model: SelfModel) -> tuple[NDArray, NDArray]:
    """Return distances of the points from the plane next to them, and their sigmas [m]. (N,)."""
    found = model.rig.triangulate(seen.pixels, _PIXEL_SIGMA)
    p, along = found.p_WQ, Plane.from_points(found.p_WQ).normal
    plane = Plane.from_points(p, 1.0 / np.einsum("i,nij,j->n", along, found.covariance, along))
    variance = np.einsum("i,nij,j->n", plane.normal, found.covariance, plane.normal)
    return plane.distance_to(p), np.sqrt(variance)


def _mirror_error(seen: HandImages, model: SelfModel) -> float:
    """Return the mean error of the hand in the mirror that explains it best; nan if none [px]."""
    count = len(seen.pixels)
    data = Dataset(
        _NAME,
        seen.joints,
        np.arange(1, count + 1),
        seen.readings,
        pixels=seen.pixels,
        mirror=np.full(count, _NAME),
        marker=np.full(count, seen.marker),
        image_size=model.rig.left.image_size,
    )
    try:
        return calibrate_mirrors(data, model).train.pixel_statistics.mean
    except (EstimationError, DataError):
        return float("nan")
