"""What lenses leave: of boards that were left out, of corners learned from, over the image.

One lens is better than another where boards that were left out are met better by more than 1 % and
two standard errors. Where they are not, corners are likelier under one of them, each number that
they need counted as a unit of the logarithm (Akaike 1974): a coefficient that gains less is none.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.dataset.board_views import BoardViews
from nico_selfmodel.errors import EstimationError, ModelError
from nico_selfmodel.estimation.cameras.board_accuracy import cross_validate_cameras
from nico_selfmodel.estimation.cameras.camera_adjustment import CameraCalibration
from nico_selfmodel.estimation.cameras.camera_assessment import fails_the_lens, is_notable
from nico_selfmodel.estimation.cameras.camera_calibration import calibrate_cameras
from nico_selfmodel.estimation.cameras.camera_options import CameraOptions
from nico_selfmodel.estimation.cameras.lenses.lens_folds import (
    ends_early,
    folds_by_chance,
    folds_of,
)
from nico_selfmodel.estimation.cameras.lenses.lens_fractions import told_together
from nico_selfmodel.estimation.cameras.lenses.lens_misfit import LensMisfit, lens_misfits
from nico_selfmodel.model.cameras.projection import FISHEYE, POLYNOMIAL, RATIONAL

_LAST = {POLYNOMIAL: ("k3",), FISHEYE: ("k4",), RATIONAL: ("k3", "k6")}
"""Coefficients that are left out where a lens folds, ends, or is not told."""
_GAIN = 0.01
"""Mean logarithm of the errors' ratio that boards left out must gain ..."""
_TOLD = 2.0
"""... and its standard errors."""
_AGREED = 1.645
"""Standard errors by which boards must agree that corners are likelier: of nothing, one time of
twenty by chance (Vuong 1989)."""
_FAR_LIKELIER = 5.0
"""Logarithm of the likelihoods' ratio that leaves no doubt (Kass, Raftery 1995: 2 ln B > 10)."""
_FAR_NEARER = 0.1
"""Mean logarithm of the errors' ratio of boards left out that is no chance: the noise of a number
more moved it by 0.08 at most in 80 simulated cameras."""


@dataclass(frozen=True, eq=False)
class LensEvidence:
    """What one lens leaves."""

    options: CameraOptions
    calibration: CameraCalibration
    residuals: NDArray
    """Of each board, predicted without its fold: `cross_validate_cameras`."""
    left_out: NDArray
    """Logarithm of their rms. Shape (V,)."""
    flawed: bool
    simpler: CameraCalibration | None = None
    """Without its last coefficients, where it is not so already."""
    without: tuple[str, ...] = ()
    """Coefficients that were left out, because corners do not need them."""

    @classmethod
    def by(cls, found: CameraCalibration, options: CameraOptions) -> "LensEvidence":
        """Predict each board without its fold."""
        everything = np.ones(len(found.views), dtype=bool)
        left = cross_validate_cameras(found, options, everything)
        if not len(left):
            raise EstimationError("too few boards to leave some out")
        rms = 0.5 * np.log(2.0 * np.nanmean(left**2, axis=(1, 2)))
        return cls(options, found, left, rms, _is_flawed(found, options))

    @property
    def forms(self) -> tuple["LensEvidence", ...]:
        """It, and it without its last coefficients."""
        less = [] if self.simpler is None else [replace(self, calibration=self.simpler)]
        return (self, *less)

    @property
    def mean(self) -> float:
        """Of the logarithms."""
        return float(self.left_out.mean())

    def worse_than(self, other: "LensEvidence") -> bool:
        """Whether boards gain by another lens."""
        gain = self.left_out - other.left_out
        mean, sigma = float(gain.mean()), float(gain.std(ddof=1) / np.sqrt(len(gain)))
        return mean > _GAIN and mean > _TOLD * sigma


def needed_of(
    views: BoardViews, options: CameraOptions, known: CameraCalibration | None = None
) -> LensEvidence | None:
    """Return what a lens leaves, less coefficients that do harm and that corners do not need."""
    whole, last = evidence_of(views, options, known), _last(views, options)
    less = replace(options, pinned={**dict.fromkeys(last, 0.0), **options.pinned})
    if whole is not None and not (whole.flawed or ends_early(whole.calibration)):
        return replace(whole, simpler=_learned(views, less)) if last else whole
    simpler = evidence_of(views, less) if last else None
    if simpler is None:
        return whole
    if whole is not None and not _suffices(simpler, whole):
        return replace(whole, simpler=simpler.calibration)
    return replace(simpler, without=last, calibration=told_together(simpler.calibration))


def _last(views: BoardViews, options: CameraOptions) -> tuple[str, ...]:
    """Return coefficients that may be left out; none where all of them are held already."""
    last = (
        (camera, k)
        for camera, lens in zip(views.cameras, options.lenses(views.cameras), strict=True)
        for k in _LAST[lens]
    )
    return tuple(f"{c}.{k}" for c, k in last if not {k, f"{c}.{k}"} & set(options.pinned))


def _suffices(simpler: LensEvidence, whole: LensEvidence) -> bool:
    """Whether a lens may do without its last coefficients, which do harm."""
    if simpler.flawed or simpler.worse_than(whole):
        return False
    return whole.flawed or surplus(simpler, whole) <= 0.0


def evidence_of(
    views: BoardViews, options: CameraOptions, known: CameraCalibration | None = None
) -> LensEvidence | None:
    """Return what a lens leaves, learned already or not; None where it cannot be learned."""
    found = _learned(views, options) if known is None else known
    try:
        return None if found is None else LensEvidence.by(found, options)
    except (EstimationError, ModelError, ValueError):
        return None


def _learned(views: BoardViews, options: CameraOptions) -> CameraCalibration | None:
    try:
        return calibrate_cameras(views, options)
    except (EstimationError, ModelError, ValueError):
        return None


def surplus(one: LensEvidence, other: LensEvidence) -> float:
    """Return by how much a lens is less likely than another, each number needed counted as one.

    A number that makes corners likelier by less than it counts is not needed.
    """
    return min(max(_by_numbers(a, b) for b in other.forms) for a in one.forms)


def _by_numbers(one: LensEvidence, other: LensEvidence) -> float:
    numbers = len(one.calibration.names) - len(other.calibration.names)
    return float(unlikelier(one, other).sum()) + numbers


def is_likelier(one: LensEvidence, other: LensEvidence) -> bool:
    """Tell which of two lenses that unseen boards do not refuse is the likelier one.

    The corners learned from say so. Where they leave doubt, a lens of another kind that bends to
    all of them ends not far beyond, or misses boards at the edge that it was learned without.
    """
    less, gain = surplus(other, one), other.mean - one.mean
    if abs(less) > _FAR_LIKELIER:
        return less > 0.0
    if abs(gain) > _FAR_NEARER:
        return gain > 0.0
    ends = ends_early(other.calibration) - ends_early(one.calibration)
    return ends > 0 or (ends == 0 and less > 0.0)


def unlikelier(one: LensEvidence, other: LensEvidence) -> NDArray:
    """Return by how much each board's corners are less likely under one lens than under another.

    A logarithm, of boards that are outliers to neither. Shape (n,).
    """
    both = ~(one.calibration.outliers | other.calibration.outliers)
    sigma = min(one.calibration.pixel_sigma, other.calibration.pixel_sigma)
    squares = [
        np.nansum(found.calibration.residuals[both] ** 2, axis=(1, 2)) for found in (one, other)
    ]
    return np.asarray(0.5 * (squares[0] - squares[1]) / sigma**2)


def is_wrong(own: LensEvidence, other: LensEvidence) -> bool:
    """Tell whether another lens is right in place of the one asked for.

    Where a few boards alone tell, unseen ones scatter; where a wrong lens comes near, as a fisheye
    does to a rational one in the middle of the image, they gain less than that, but its misfit is
    several times what a place in the image is said to be uncertain by. Then the corners learned
    from decide, board by board, as where the lens is left to them; of all boards together, where
    the lens asked for ends in front of the camera and the other does not.
    """
    if own.worse_than(other):
        return True
    if other.worse_than(own):
        return False
    gain = float((own.left_out - other.left_out).mean())
    less = unlikelier(own, other)
    sigma = float(less.std(ddof=1)) * np.sqrt(len(less))
    ends = ends_early(own.calibration) and not ends_early(other.calibration)
    told = ends or gain > _GAIN or float(less.sum()) > _AGREED * sigma
    return told and surplus(own, other) > _FAR_LIKELIER


def gains_by(own: LensEvidence, more: LensEvidence) -> bool:
    """Tell whether boards that were left out gain by numbers more: a hundredth, and for sure.

    Sure is what two standard errors say, or corners that are far likelier besides (`is_wrong`), of
    a lens that folds no image that the other one does not.
    """
    if own.worse_than(more):
        return True
    names, gain = own.calibration.views.cameras, float((own.left_out - more.left_out).mean())
    before, after = (set(folds_of(names, one.calibration.cameras)) for one in (own, more))
    sound = not more.flawed and after <= before
    return sound and gain > _GAIN and is_wrong(own, more)


def leaves_doubt(own: LensEvidence, other: LensEvidence, less: float) -> bool:
    """Tell whether another lens explains unseen boards, and corners not so much less likely.

    One that misses unseen boards by far more leaves none, be it by a few boards alone.
    """
    refused = other.flawed or other.worse_than(own) or other.mean - own.mean > _FAR_NEARER
    return not refused and surplus(other, own) < less


def misfits_of(found: CameraCalibration, options: CameraOptions) -> tuple[LensMisfit, ...]:
    """Return what residuals have in common over the image, of each camera."""
    return lens_misfits(found, options.aspect)


def _is_flawed(found: CameraCalibration, options: CameraOptions) -> bool:
    """Whether a lens would fail: most of its residuals a pattern, a folded image, or not told."""
    return _breaks(found) or any(map(fails_the_lens, misfits_of(found, options)))


def asks_for_others(found: CameraCalibration, options: CameraOptions) -> bool:
    """Whether a lens would fail, or its residuals have anything notable in common."""
    return _breaks(found) or any(map(is_notable, misfits_of(found, options)))


def _breaks(found: CameraCalibration) -> bool:
    """Whether a lens folds its image, or is not told."""
    return bool(_folded(found)) or bool(found.uncertainty.unobservable)


def _folded(found: CameraCalibration) -> set[str]:
    """Return the cameras whose lens folds the image where its boards do not leave it open."""
    views = found.views
    return set(folds_of(views.cameras, found.cameras)) - folds_by_chance(found)
