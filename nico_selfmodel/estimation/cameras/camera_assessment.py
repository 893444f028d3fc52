"""A camera calibration with everything that tells how far it may be trusted."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.dataset.board_views import BoardViews
from nico_selfmodel.estimation.cameras.board_accuracy import (
    PairAccuracy,
    corner_distances,
    cross_validate_cameras,
    held_out_residuals,
    pairs_of,
)
from nico_selfmodel.estimation.cameras.camera_adjustment import CameraCalibration
from nico_selfmodel.estimation.cameras.camera_initialization import within_reach
from nico_selfmodel.estimation.cameras.camera_options import CameraOptions, lens_word
from nico_selfmodel.estimation.cameras.known_cameras import KnownCameras, other_scale
from nico_selfmodel.estimation.cameras.lacks.rig_lacks import Lack, lacks_of
from nico_selfmodel.estimation.cameras.lenses.lens_folds import folds_by_chance, folds_of
from nico_selfmodel.estimation.cameras.lenses.lens_fractions import with_told_sigmas
from nico_selfmodel.estimation.cameras.lenses.lens_misfit import (
    LensMisfit,
    lens_fields,
    lens_misfits,
)
from nico_selfmodel.estimation.cameras.parts_of_boards import joined, turned_to_fit
from nico_selfmodel.estimation.cameras.projection_uncertainty import ProjectionUncertainty
from nico_selfmodel.model.cameras.projection import POLYNOMIAL, RATIONAL
from nico_selfmodel.model.self_model import SelfModel

_COVERED = 0.75
"""Corners should reach this far from the image's centre towards its corner."""
_SLIGHT, _MOSTLY = 0.2, 0.5
"""Share of the squared residuals that a misfit of the lens is mentioned from, and fails from ..."""
_SLIGHT_PX, _NOTABLE_PX = 0.05, 0.1
"""... where it moves corners by so much in the root mean square [px]."""


@dataclass(frozen=True, eq=False)
class CameraAssessment:
    """What a calibration is worth."""

    calibration: CameraCalibration
    """What was learned."""
    left_out_residuals: NDArray
    """Measured minus predicted pixels of boards cross-validated [px]. Shape (n, P, 2 C)."""
    test_views: BoardViews | None
    """Held-out boards."""
    test_residuals: NDArray | None
    """Measured minus predicted pixels of the held-out boards [px]. Shape (V, P, 2 C)."""
    pairs: tuple[PairAccuracy, ...]
    """What cameras do together that saw boards at once; empty for one camera."""
    misfits: tuple[LensMisfit, ...]
    """What the residuals of each camera have in common over the image."""
    projection: tuple[ProjectionUncertainty, ...]
    """How uncertain it is where each camera projects."""
    better_lens: str | None = None
    """The lens by which unseen boards are met better than by the one that was asked for."""
    rival_lens: str | None = None
    """The lens that boards do not tell from the one asked for: `LensChoice.rival`."""
    known: KnownCameras | None = None
    """What the cameras that were known before leave; None where none were given."""
    decentred: tuple[str, ...] = ()
    """Cameras whose boards ask for p1 and p2; those of all cameras were let move then."""
    beyond_reach: tuple[str, ...] = ()
    """Held-out boards beyond the reach of every lens that saw them; not in `test_views`."""
    lens_by_boards: bool = False
    """Whether the boards chose the lens: `--lens auto`."""
    lacks: tuple[Lack, ...] = ()
    """What boards and cameras did that the model does not have."""

    @classmethod
    def from_calibration(
        cls,
        calibration: CameraCalibration,
        options: CameraOptions | None = None,
        test: BoardViews | None = None,
        known: SelfModel | None = None,
        better_lens: str | None = None,
        rival_lens: str | None = None,
        decentred: tuple[str, ...] = (),
        left_out: NDArray | None = None,
        lens_by_boards: bool = False,
    ) -> "CameraAssessment":
        """Cross-validate, and hold against other views where given.

        Args:
            test: Views that were held out.
            known: The cameras as they were known before, to be compared.
            better_lens: `LensChoice.better`.
            rival_lens: `LensChoice.rival`.
            decentred: `LensChoice.decentred`.
            left_out: `LensChoice.left_out`, which is taken where no board was an outlier.
            lens_by_boards: `LensChoice.by_boards`.

        Raises:
            DataError, EstimationError, ModelError: If the known cameras cannot have seen them.
        """
        options = options or CameraOptions()
        calibration = with_told_sigmas(calibration, options)
        views, inliers = calibration.views, ~calibration.outliers
        if left_out is None or not inliers.all():
            left_out = cross_validate_cameras(calibration, options, inliers)
        if test is not None and len(test.cameras) > 1:
            test = joined(turned_to_fit(test, calibration.cameras), calibration.cameras)
        test, beyond = _within_reach(calibration, test)
        shown = test if test is not None else views.select(inliers)
        misfits = lens_misfits(calibration, options.aspect)
        return cls(
            calibration,
            left_out,
            test,
            None if test is None else held_out_residuals(calibration.cameras, test),
            pairs_of(calibration, shown),
            misfits,
            tuple(
                ProjectionUncertainty.of(calibration, camera, options.aspect)
                for camera in calibration.views.cameras
            ),
            better_lens,
            rival_lens,
            None if known is None else KnownCameras.on(known, shown, test is not None),
            decentred,
            beyond,
            lens_by_boards,
            lacks_of(calibration, options.aspect, _fields_of(calibration, misfits)),
        )

    def lens_of(self, camera: str) -> str:
        """Return the lens of a camera, one of `model.cameras.projection.LENSES`."""
        return self.calibration.cameras[self.calibration.views.cameras.index(camera)].lens

    @property
    def lens(self) -> str:
        """The lenses of the cameras, as `--lens` takes them."""
        lenses = {name: self.lens_of(name) for name in self.calibration.views.cameras}
        return lens_word(lenses)

    def words_of(self, misfit: LensMisfit) -> str:
        """Say what a lens does that its model does not, and what may cure it."""
        return _words_of_misfit(misfit, self.lens_of(misfit.camera), self.lens_by_boards)

    @property
    def pair(self) -> PairAccuracy | None:
        """What a left and a right camera do together; None for one camera, and for many."""
        return self.pairs[0] if len(self.calibration.cameras) == 2 and self.pairs else None

    @property
    def cross_validation(self) -> NDArray:
        """Reprojection errors of boards cross-validated [px]. Shape (n,)."""
        return corner_distances(self.left_out_residuals)

    @property
    def train_distances(self) -> NDArray:
        """Reprojection errors of the inlier boards [px]. Shape (n,)."""
        return corner_distances(self.calibration.residuals[~self.calibration.outliers])

    @property
    def test_distances(self) -> NDArray | None:
        """Reprojection errors of the held-out boards [px]. Shape (n,)."""
        return None if self.test_residuals is None else corner_distances(self.test_residuals)

    @property
    def warnings(self) -> tuple[str, ...]:
        """What the data cannot support, in words, though nothing fails."""
        scale = None if self.known is None else other_scale(self.known, self.calibration)
        return (
            *_folds_by_chance(self.calibration),
            *_weak_parameters(self.calibration),
            *_told_together(self.calibration),
            *_coverage_warnings(self.calibration),
            *(self.words_of(misfit) for misfit in self.misfits if _is_slight(misfit)),
            *([] if scale is None else [scale]),
        )


def _fields_of(
    calibration: CameraCalibration, misfits: tuple[LensMisfit, ...]
) -> tuple[NDArray, ...]:
    """Return how lenses that are no such lens may displace corners. Shapes (V, F, k)."""
    told = [camera for camera, misfit in enumerate(misfits) if is_notable(misfit)]
    return tuple(lens_fields(calibration, camera) for camera in told)


def _within_reach(
    calibration: CameraCalibration, test: BoardViews | None
) -> tuple[BoardViews | None, tuple[str, ...]]:
    """Return held-out boards that the learned lenses see, if any, and the names of the others."""
    if test is None:
        return None, ()
    seen = within_reach(calibration.cameras, test)
    beyond = tuple(test.names[v] for v in np.flatnonzero(~seen))
    return test.select(seen) if seen.any() else None, beyond


def _weak_parameters(calibration: CameraCalibration) -> list[str]:
    """Name distortion terms that the data cannot tell from zero."""
    words = []
    for i, name in enumerate(calibration.names):
        camera, _, what = name.partition(".")
        sigma = float(calibration.uncertainty.sigma[i])
        if what not in ("k2", "k3", "p1", "p2", "skew") or not np.isfinite(sigma):
            continue
        value = getattr(calibration.cameras[calibration.views.cameras.index(camera)], what)
        if abs(value) < 2.0 * sigma:
            words.append(
                f"`{name}` is {value:.2g} +- {sigma:.1g}: not to be told from zero; --fix {name}=0 "
                "would lose nothing"
            )
    return words


def _told_together(calibration: CameraCalibration) -> list[str]:
    """Say where coefficients of a rational lens stand for each other."""
    words = []
    for name, camera in zip(calibration.views.cameras, calibration.cameras, strict=True):
        sigma = {
            n: s
            for n, s in zip(calibration.names, calibration.uncertainty.sigma, strict=True)
            if n.startswith(f"{name}.k")
        }
        untold = any(sigma) and np.isinf(list(sigma.values())).all()
        if camera.lens == RATIONAL and untold and not calibration.uncertainty.unobservable:
            words.append(
                f"k1 to k6 of the {name} camera's rational lens stand for each other: a fraction "
                "of a degree less explains the corners nearly as well, so that only all of them "
                "together are told, and where pixels lie; they have no sigmas of their own"
            )
    return words


def _coverage_warnings(calibration: CameraCalibration) -> list[str]:
    """Say how far the corners reach into the image's corners."""
    words = []
    for camera, size in zip(calibration.views.cameras, calibration.views.image_sizes, strict=True):
        half = 0.5 * (np.array(size) - 1.0)
        pixels = calibration.views.of_camera(camera).reshape(-1, 2)
        reach = float(np.nanmax(np.linalg.norm(pixels - half, axis=1)) / np.linalg.norm(half))
        if reach < _COVERED:
            words.append(
                f"no corner in the {camera} camera lies further out than {100 * reach:.0f} % of "
                "the way to the image's corner: beyond, its distortion is extrapolated"
            )
    return words


def _folds_by_chance(calibration: CameraCalibration) -> list[str]:
    views, by_chance = calibration.views, folds_by_chance(calibration)
    folds = folds_of(views.cameras, calibration.cameras)
    return [words for camera, words in folds.items() if camera in by_chance]


def fails_the_lens(misfit: LensMisfit) -> bool:
    """Tell whether most of a camera's residuals are its lens' misfit, and more than a trifle."""
    large = misfit.share >= _MOSTLY and misfit.size_px >= _NOTABLE_PX
    return misfit.is_certain and large


def is_notable(misfit: LensMisfit) -> bool:
    """Tell whether a lens' misfit is worth a word."""
    return misfit.is_certain and misfit.share >= _SLIGHT and misfit.size_px >= _SLIGHT_PX


def _is_slight(misfit: LensMisfit) -> bool:
    return is_notable(misfit) and not fails_the_lens(misfit)


def _words_of_misfit(misfit: LensMisfit, lens: str, by_boards: bool) -> str:
    share = round(100 * misfit.share)
    words = (
        f"the lens of the {misfit.camera} camera bends light as its model does not: corners lie "
        f"{misfit.size_px:.2f} px off in a pattern over the image, {share} % of their squared error"
    )
    if misfit.held:
        return f"{words}; let {' and '.join(f'`{name}`' for name in misfit.held)} move"
    if by_boards:
        return (
            f"{words}, and --lens auto found no better lens: look for pictures of another zoom or "
            "focus, and a board that is not flat"
        )
    if lens != POLYNOMIAL:
        return f"{words}; --lens auto takes the best of the lenses there are"
    return (
        f"{words}; fisheyes and other wide lenses are not described by k1 to k3: let the boards "
        "choose with --lens auto"
    )
