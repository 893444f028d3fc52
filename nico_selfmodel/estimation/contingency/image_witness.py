"""What moves when I do: a mirror, a picture of me, or somebody who imitates me at once.

Timing cannot tell them (`contingency`), geometry can: a mirror's image lies behind it, each of its
points as far as the point itself is before it, and is turned round; a picture lies in its screen,
whichever camera looks; and whoever imitates is somewhere else, and not turned round. Who stands
turned round in the mirror image's place has joints that err otherwise (`shared_error`).
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.dataset.dataset import Dataset
from nico_selfmodel.dataset.joint_info import JointInfo
from nico_selfmodel.errors import DataError, EstimationError
from nico_selfmodel.estimation.arm.evaluation import noise_at
from nico_selfmodel.estimation.contingency.contingency import ODDS
from nico_selfmodel.estimation.contingency.shared_error import shared_error
from nico_selfmodel.estimation.mirrors.mirror import calibrate_mirrors
from nico_selfmodel.estimation.noise.pose_noise import PoseNoise
from nico_selfmodel.geometry.plane import Plane
from nico_selfmodel.model.cameras.mirror_rig import MirrorRig
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
    own: NDArray
    """Left u, v, right u, v of the own hand's marker in the same pictures; nan where it was not
    seen in both [px]. Shape (N, 4)."""


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
    shared: float
    """Logarithm of the odds that the image errs as the own hand does, against joints of its own;
    nan where no mirror fits, or it is not known how much joints err."""


def tell_image(seen: HandImages, model: SelfModel) -> ImageVerdict:
    """Say what an image of one's own hand is.

    Points that both cameras see lie in a plane where the chi-square of their distances from it is
    no rarer than one in a thousand; then it is a picture, if the own hand did not move in a plane
    itself. Otherwise it is a mirror where the image is turned round and a mirror's plane explains
    it, unless it has joints of its own: who is that is another, as is who is not turned round.

    Raises:
        ModelError: If the model has no arm or no pair of cameras.
    """
    looks, turned = len(seen.pixels), int(np.sum(seen.mirrored))
    if looks < FEWEST:
        nan = float("nan")
        return ImageVerdict(CANNOT_TELL, looks, nan, nan, nan, nan, nan)
    off, sigma = _off_plane(seen, model)
    p_WH = model.points(model.servos.to_joint(seen.readings))
    hand = Plane.from_points(p_WH).distance_to(p_WH)
    mirror_px, shared = _by_mirror(seen, model) if turned == looks else (float("nan"),) * 2
    if chi_square_tail(float(np.sum((off / sigma) ** 2)), looks - 3) > _BY_CHANCE:
        deep = float(np.sum((hand / sigma) ** 2)) > _POWER
        verdict = PICTURE if deep else CANNOT_TELL
    elif mirror_px < _MOST_PX:
        verdict = ANOTHER if shared < -np.log(ODDS) else MIRROR
    else:
        verdict = CANNOT_TELL if turned else ANOTHER
    depth, noise, own = (
        1e3 * float(np.sqrt(np.mean(np.square(each)))) for each in (off, sigma, hand)
    )
    return ImageVerdict(verdict, looks, depth, noise, own, mirror_px, shared)


def _off_plane(seen: HandImages, model: SelfModel) -> tuple[NDArray, NDArray]:
    """Return distances of the points from the plane next to them, and their sigmas [m]. (N,)."""
    found = model.rig.triangulate(seen.pixels, _PIXEL_SIGMA)
    p, along = found.p_WQ, Plane.from_points(found.p_WQ).normal
    plane = Plane.from_points(p, 1.0 / np.einsum("i,nij,j->n", along, found.covariance, along))
    variance = np.einsum("i,nij,j->n", plane.normal, found.covariance, plane.normal)
    return plane.distance_to(p), np.sqrt(variance)


def _by_mirror(seen: HandImages, model: SelfModel) -> tuple[float, float]:
    """Return the mean error of the hand in the mirror that explains it best, and what is shared.

    Returns:
        `ImageVerdict.mirror_px` and `shared`; nan where no mirror explains it.
    """
    count, nan = len(seen.pixels), float("nan")
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
        found = calibrate_mirrors(data, model)
    except (EstimationError, DataError):
        return nan, nan
    error = found.train.pixel_statistics.mean
    learned, noise = PoseNoise.of(model), noise_at(model, seen.readings, np.zeros(count, dtype=int))
    if learned is None or noise is None:
        return error, nan
    of_joints = noise - learned.sensor_sigma**2 * np.eye(3)
    p_WH = model.points(model.servos.to_joint(seen.readings))
    rig = MirrorRig(model.rig, found.mirrors[_NAME])
    return error, shared_error(seen.pixels, seen.own, p_WH, of_joints, rig, _PIXEL_SIGMA)
