"""Every view of a calibration, whatever became of it."""

import re
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.estimation.cameras.camera_assessment import CameraAssessment
from nico_selfmodel.viz.figures import palette
from nico_selfmodel.viz.figures.photographs import Photographs

USES = ("training", "held-out", "outlier", "no board found")
"""What became of a view."""
USE_COLORS = dict(
    zip(
        USES, (palette.TRAINING, palette.HELD_OUT, palette.OUTLIER, palette.CROSS_VALIDATION),
        strict=True,
    )
)  # fmt: skip


@dataclass(frozen=True, eq=False)
class CameraView:
    """What one camera saw of a board."""

    side: str
    """`left` or `right`."""
    file: str
    """Name of the photograph; the camera and the view where it is not known."""
    pixels: NDArray
    """Corners, nan where not seen [px]. Shape (P, 2)."""
    residuals: NDArray
    """Measured minus predicted [px]. Shape (P, 2)."""

    @property
    def errors(self) -> NDArray:
        """Reprojection error of the corners that were seen [px]. Shape (n,)."""
        distances = np.linalg.norm(self.residuals, axis=1)
        return distances[np.isfinite(distances)]

    @property
    def rms(self) -> float | None:
        """Root mean square error [px], None where nothing was seen."""
        return _root_mean_square(self.errors)


@dataclass(frozen=True, eq=False)
class ShownView:
    """One moment, as each camera saw it."""

    name: str
    """As in the data."""
    use: str
    """One of `USES`."""
    cameras: tuple[CameraView, ...]
    """Left and right, or one of them."""

    @property
    def rms(self) -> float | None:
        """Root mean square error over the cameras [px]."""
        return _root_mean_square(np.concatenate([camera.errors for camera in self.cameras]))


def shown_views(
    assessment: CameraAssessment,
    document: Mapping[str, Any] | None = None,
    images: Photographs | None = None,
) -> tuple[ShownView, ...]:
    """Return all views: learned from, outliers, held out, or without a board.

    Args:
        document: Content of `result.json`; its `detection` may hold `files`, camera -> view ->
            name, and `not_seen`, name of a file -> what was tried.
        images: Photographs, which may show views in which no board was found.

    Returns:
        The views in the order of their names.
    """
    calibration = assessment.calibration
    files = ((document or {}).get("detection") or {}).get("files") or {}
    sides = calibration.views.cameras
    rows: dict[str, tuple[str, NDArray, NDArray]] = {}
    for name, out, pixels, residuals in zip(
        calibration.views.names,
        calibration.outliers.tolist(),
        calibration.views.pixels,
        calibration.residuals,
        strict=True,
    ):
        rows[name] = ("outlier" if out else "training", pixels, residuals)
    if assessment.test_views is not None and assessment.test_residuals is not None:
        held_out = assessment.test_views
        triples = zip(held_out.names, held_out.pixels, assessment.test_residuals, strict=True)
        rows |= {name: ("held-out", pixels, residuals) for name, pixels, residuals in triples}
    nothing = np.full((len(calibration.views.p_GQ), 2 * len(sides)), np.nan)
    for name in (name for of_camera in (images or {}).values() for name in of_camera):
        rows.setdefault(name, ("no board found", nothing, nothing))
    return tuple(
        ShownView(name, use, _camera_views(name, sides, files, pixels, residuals))
        for name, (use, pixels, residuals) in _ordered(rows)
    )


def _root_mean_square(errors: NDArray) -> float | None:
    """Return the root mean square of numbers, None where there are none."""
    return float(np.sqrt(np.mean(errors**2))) if len(errors) else None


def _camera_views(
    name: str, sides: tuple[str, ...], files: Mapping[str, Any], pixels: NDArray, residuals: NDArray
) -> tuple[CameraView, ...]:
    return tuple(
        CameraView(
            side,
            str(files.get(side, {}).get(name, f"{side} {name}")),
            pixels[:, 2 * k : 2 * k + 2],
            residuals[:, 2 * k : 2 * k + 2],
        )
        for k, side in enumerate(sides)
    )


def _ordered(rows: Mapping[str, Any]) -> list[tuple[str, Any]]:
    """Return rows by name, with view 2 before view 10."""

    def key(row: tuple[str, Any]) -> list[tuple[int, str]]:
        parts = re.split(r"(\d+)", row[0])
        return [(int(part), "") if part.isdecimal() else (-1, part) for part in parts]

    return sorted(rows.items(), key=key)
