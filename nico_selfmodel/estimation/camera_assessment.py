"""A camera calibration with everything that tells how far it may be trusted."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.dataset.board_views import BoardViews
from nico_selfmodel.estimation.board_accuracy import (
    Reconstruction,
    corner_distances,
    cross_validation,
    epipolar_errors,
    have_rays,
    held_out_residuals,
)
from nico_selfmodel.estimation.camera_adjustment import CameraCalibration
from nico_selfmodel.estimation.camera_options import CameraOptions
from nico_selfmodel.estimation.verdict import Verdict, rank_score
from nico_selfmodel.model import lens
from nico_selfmodel.model.camera import Camera
from nico_selfmodel.model.stereo_rig import StereoRig

_MOST_OUTLIERS = 0.25
_SIGNIFICANT, _NOTABLE = 3.3, 1.3
"""As in the verdict on an arm: standard score and ratio of medians of a larger held-out error."""
_EXCESSIVE = 5.0
"""Ratio that needs no statistics, for a handful of boards."""
_COVERED = 0.75
"""Corners should reach this far from the image's centre towards its corner."""


@dataclass(frozen=True, eq=False)
class CameraAssessment:
    """What a calibration is worth."""

    calibration: CameraCalibration
    """What was learned."""
    left_out_residuals: NDArray
    """Measured minus predicted pixels of boards left out in turn [px]. Shape (n, P, 2 C)."""
    test_views: BoardViews | None
    """Held-out boards."""
    test_residuals: NDArray | None
    """Measured minus predicted pixels of the held-out boards [px]. Shape (V, P, 2 C)."""
    epipolar: NDArray | None
    """Distances from epipolar lines in both images [px], of a pair. Shape (V, P, 2)."""
    reconstruction: Reconstruction | None
    """Boards rebuilt by triangulation, of a pair; the held-out ones where there are some."""

    @classmethod
    def from_calibration(
        cls,
        calibration: CameraCalibration,
        options: CameraOptions | None = None,
        test: BoardViews | None = None,
    ) -> "CameraAssessment":
        """Cross-validate, and hold against other views where given.

        Args:
            calibration: What was learned.
            options: As it was learned.
            test: Views that were held out.

        Returns:
            The assessment.
        """
        options = options or CameraOptions()
        views, believed = calibration.views, ~calibration.outliers
        left_over = cross_validation(views, options, believed)
        pair = len(calibration.cameras) == 2
        shown = test if test is not None else views.select(believed)
        return cls(
            calibration,
            left_over,
            test,
            None if test is None else held_out_residuals(calibration.cameras, test),
            epipolar_errors(calibration.rig, views) if pair else None,
            _rebuilt(calibration.rig, shown) if pair else None,
        )

    @property
    def cross_validation(self) -> NDArray:
        """Reprojection errors of boards left out in turn [px]. Shape (n,)."""
        return corner_distances(self.left_out_residuals)

    @property
    def train_distances(self) -> NDArray:
        """Reprojection errors of the believed boards [px]. Shape (n,)."""
        return corner_distances(self.calibration.residuals[~self.calibration.outliers])

    @property
    def test_distances(self) -> NDArray | None:
        """Reprojection errors of the held-out boards [px]. Shape (n,)."""
        return None if self.test_residuals is None else corner_distances(self.test_residuals)

    @property
    def warnings(self) -> tuple[str, ...]:
        """What the data cannot support, in words, though nothing fails."""
        return (*_weak_parameters(self.calibration), *_coverage_warnings(self.calibration))


def _rebuilt(rig: StereoRig, views: BoardViews) -> Reconstruction:
    """Rebuild the boards for all corners of which both lenses have a ray."""
    rays = have_rays(rig, views.pixels.reshape(-1, 4)).reshape(len(views), -1)
    return Reconstruction.from_views(rig, views.select(rays.all(axis=1)))


def judge_cameras(assessment: CameraAssessment, require_test_px: float | None = None) -> Verdict:
    """Judge a camera calibration.

    Args:
        assessment: What it is worth.
        require_test_px: Largest rms reprojection error of held-out boards allowed [px].

    Returns:
        FAIL where a check fails; PASS where boards were held out and nothing failed;
        NOT_EVALUATED where none were.
    """
    calibration = assessment.calibration
    checks = [
        None if calibration.converged else "the solver stopped without reaching a minimum",
        *_blind_reasons(calibration),
        _outlier_reason(calibration),
        *_fold_reasons(calibration),
        _held_out_reason(assessment),
        _bound_reason(assessment, require_test_px),
    ]
    failed = tuple(reason for reason in checks if reason)
    if failed:
        return Verdict("FAIL", failed)
    distances = assessment.test_distances
    if distances is None or assessment.test_views is None:
        return Verdict("NOT_EVALUATED", ("no board was held out: give --test-fraction",))
    rms = float(np.sqrt(np.mean(distances**2)))
    boards = len(assessment.test_views)
    return Verdict("PASS", (f"{rms:.3f} px rms on {boards} boards that were held out",))


def _blind_reasons(calibration: CameraCalibration) -> list[str]:
    return [
        f"the boards do not determine {', '.join(f'`{name}`' for name in direction.names)}: "
        "tilt the board more, bring it nearer to the image's edges and to other distances, or hold "
        f"a value with --pin {direction.names[0]}"
        for direction in calibration.uncertainty.blind
    ]


def _outlier_reason(calibration: CameraCalibration) -> str | None:
    share = float(calibration.outliers.mean())
    if share <= _MOST_OUTLIERS:
        return None
    return (
        f"{100 * share:.0f} % of the boards contradict the rest: is the board flat and of the size "
        "given, and were the images of a pair taken together?"
    )


def _fold_reasons(calibration: CameraCalibration) -> list[str]:
    views = calibration.views
    return fold_reasons_of(views.eyes, calibration.cameras, views.image_size)


def fold_reasons_of(
    eyes: tuple[str, ...], cameras: tuple[Camera, ...], image_size: tuple[int, int]
) -> list[str]:
    """Say where a lens folds its image: pixels to which no ray belongs."""
    reasons = []
    width, height = image_size
    edge = np.array([[0, 0], [width - 1, 0], [0, height - 1], [width - 1, height - 1]], dtype=float)
    for eye, camera in zip(eyes, cameras, strict=True):
        if not camera.has_rays(edge).all():
            reasons.append(
                f"the distortion of the {eye} eye is not monotone up to the image's corners (it "
                f"turns at a radius of {lens.largest_radius(camera.k):.2f}): pin {eye}.k3=0, or "
                "record boards in the corners"
            )
    return reasons


def _held_out_reason(assessment: CameraAssessment) -> str | None:
    """Compare boards, not corners: what is wrong with one corner of a board is with all."""
    if assessment.test_residuals is None or len(assessment.left_out_residuals) == 0:
        return None
    found = _rms_of_boards(assessment.test_residuals)
    expected = _rms_of_boards(assessment.left_out_residuals)
    ratio = float(np.median(found) / max(np.median(expected), 1e-12))
    significant = rank_score(expected, found) >= _SIGNIFICANT and ratio >= _NOTABLE
    if not significant and ratio < _EXCESSIVE:
        return None
    return (
        f"held-out boards fit significantly worse (median rms {np.median(found):.3f} px) than "
        f"boards left out in turn ({np.median(expected):.3f} px)"
    )


def _rms_of_boards(residuals: NDArray) -> NDArray:
    """Return the root mean square error of each board. Shape (V, P, 2 C) -> (V,)."""
    return np.sqrt(2.0 * np.nanmean(residuals**2, axis=(1, 2)))


def _bound_reason(assessment: CameraAssessment, require_test_px: float | None) -> str | None:
    if require_test_px is None:
        return None
    distances = assessment.test_distances
    if distances is None:
        return "--require-test-px was given but no board was held out"
    rms = float(np.sqrt(np.mean(distances**2)))
    if rms <= require_test_px:
        return None
    return f"held-out boards fit to {rms:.3f} px rms, required at most {require_test_px:g} px"


def _weak_parameters(calibration: CameraCalibration) -> list[str]:
    """Name distortion terms that the data cannot tell from zero."""
    words = []
    for i, name in enumerate(calibration.names):
        eye, _, what = name.partition(".")
        sigma = float(calibration.uncertainty.sigma[i])
        if what not in ("k2", "k3", "p1", "p2", "skew") or not np.isfinite(sigma):
            continue
        value = getattr(calibration.cameras[calibration.views.eyes.index(eye)], what)
        if abs(value) < 2.0 * sigma:
            words.append(
                f"`{name}` is {value:.2g} +- {sigma:.1g}: not to be told from zero; --pin {name}=0 "
                "would lose nothing"
            )
    return words


def _coverage_warnings(calibration: CameraCalibration) -> list[str]:
    """Say how far the corners reach into the image's corners."""
    words, half = [], 0.5 * (np.array(calibration.views.image_size) - 1.0)
    for eye in calibration.views.eyes:
        pixels = calibration.views.of_eye(eye).reshape(-1, 2)
        reach = float(np.nanmax(np.linalg.norm(pixels - half, axis=1)) / np.linalg.norm(half))
        if reach < _COVERED:
            words.append(
                f"no corner in the {eye} eye lies further out than {100 * reach:.0f} % of the way "
                "to the image's corner: beyond, its distortion is extrapolated"
            )
    return words
