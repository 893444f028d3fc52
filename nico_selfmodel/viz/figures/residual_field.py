"""The figure of residuals over the image: what a lens model cannot express shows as a pattern."""

from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from nico_selfmodel.estimation.cameras.camera_assessment import CameraAssessment
from nico_selfmodel.viz.figures import palette
from nico_selfmodel.viz.figures.camera_plots import cell_counts, image_panels
from nico_selfmodel.viz.figures.numbers_shown import nice_below
from nico_selfmodel.viz.figures.plot_style import MANY, headline, style

_FEWEST_VIEWS = 3
"""That have corners in a cell whose mean is shown."""
_ARROW, _MEAN_ARROW = 0.06, 0.08
"""Lengths, in widths of the image, of a large residual and of the largest mean."""
_STANDS_OUT = 4.0
"""Standard score from which a cell's mean is no noise: among 100 cells once in a hundred times."""
_FAR = 4.0
"""Robust standard deviations to which residuals count at most, so that one corner is no pattern."""
_MAD_TO_SIGMA = 1.4826


@dataclass(frozen=True, eq=False)
class Field:
    """Residuals of one camera, and their means over cells of its image."""

    pixels: NDArray
    """Where the corners lie [px]. Shape (n, 2)."""
    residuals: NDArray
    """Measured minus predicted [px]. Shape (n, 2)."""
    cells: NDArray
    """Where the cells lie that hold enough corners [px]. Shape (k, 2)."""
    means: NDArray
    """Of the residuals in each [px]. Shape (k, 2)."""
    score: float
    """Largest standard score of a component of a mean."""


def residual_field(assessment: CameraAssessment) -> Figure:
    """Draw residuals where they lie in the image, and the means of cells, each at its own scale."""
    views = assessment.calibration.views
    fields = [field_of(assessment, k) for k in range(len(views.cameras))]
    width = max(wide for wide, _ in views.image_sizes)
    lengths = np.concatenate([np.linalg.norm(field.residuals, axis=1) for field in fields])
    means = np.concatenate([np.linalg.norm(field.means, axis=1) for field in fields])
    factor = _factor(float(np.percentile(lengths, 95)) if len(lengths) else 0.0, _ARROW * width)
    mean_factor = _factor(float(means.max(initial=0.0)), _MEAN_ARROW * width)
    with style():
        figure, panels = image_panels(assessment)
        for axes, side, field in zip(panels, views.cameras, fields, strict=True):
            look = {"width": 0.002, "alpha": 0.75, "rasterized": len(field.pixels) > MANY}
            color = palette.camera_colors(views.cameras)[side]
            _arrows(axes, field.pixels, field.residuals, factor, color, "", 0.66, **look)
            _arrows(
                axes, field.cells, field.means, mean_factor, palette.INK, "mean ", 0.9, width=0.005
            )
            squares = np.sum(field.residuals**2, axis=1)
            rms = f"{np.sqrt(squares.mean()):.3f} px rms" if len(squares) else "nothing seen"
            axes.set_title(f"{side}: {rms}")
        headline(figure, _words(views.cameras, fields))
    return figure


def field_of(assessment: CameraAssessment, camera: int) -> Field:
    """Return the residuals of the views without outliers in one camera, given by its number."""
    calibration = assessment.calibration
    inliers, columns = ~calibration.outliers, slice(2 * camera, 2 * camera + 2)
    pixels = calibration.views.pixels[inliers][:, :, columns]
    residuals = calibration.residuals[inliers][:, :, columns]
    seen = np.isfinite(pixels).all(axis=2) & np.isfinite(residuals).all(axis=2)
    view = np.nonzero(seen)[0]
    pixels, residuals = pixels[seen], residuals[seen]
    sigma = _MAD_TO_SIGMA * np.median(np.abs(residuals)) if len(residuals) else 0.0
    tame = np.clip(residuals, -_FAR * sigma, _FAR * sigma)
    _, u, v = cell_counts(pixels, calibration.views.image_sizes[camera])
    i, j = (np.digitize(pixels[:, k], edges) for k, edges in enumerate((u, v)))
    # Corners of one view share its board's errors: each view counts once in a cell.
    pairs, row = np.unique(
        np.stack([i * (len(v) + 1) + j, view], axis=1), axis=0, return_inverse=True
    )
    row, count = row.ravel(), np.bincount(row.ravel())
    of_view = _group_means(np.hstack([pixels, tame]), row, len(pairs))
    _, cell = np.unique(pairs[:, 0], return_inverse=True)
    views_in = np.bincount(cell.ravel())
    means = _group_means(of_view, cell.ravel(), len(views_in))
    # The noise of a mean, from the spread of views about it and from that of corners in a view.
    between = _noise(of_view[:, 2:] - means[cell.ravel(), 2:], len(views_in)) / np.sqrt(views_in)
    within = _noise(tame - of_view[row, 2:], len(pairs))
    within = within * np.sqrt(np.bincount(cell.ravel(), 1.0 / count)) / views_in
    scores = np.abs(means[:, 2:]).max(axis=1) / np.maximum(np.maximum(between, within), 1e-12)
    shown = views_in >= _FEWEST_VIEWS
    score = float(scores[shown].max(initial=0.0))
    means = means[shown]
    return Field(pixels, residuals, means[:, :2], means[:, 2:], score)


def _noise(apart: NDArray, groups: int) -> float:
    """Return the standard deviation of vectors that are apart from the means of their groups."""
    return float(np.sqrt(np.sum(apart**2) / max(2 * (len(apart) - groups), 1)))


def _group_means(values: NDArray, group: NDArray, count: int) -> NDArray:
    """Return the mean of each group of rows. Shapes (n, d) and (n,) -> (count, d)."""
    sums = [np.bincount(group, column, count) for column in values.T]
    return np.stack(sums, axis=1) / np.bincount(group, minlength=count)[:, None]


def _arrows(
    axes: Axes, places: NDArray, vectors: NDArray, factor: float, color: str, word: str,
    key_at: float, **look: object,
) -> None:  # fmt: skip
    """Draw vectors larger than they are, with a key above the panel."""
    if not len(places):
        return
    scale = {"angles": "xy", "scale_units": "xy", "scale": 1.0 / factor}
    axes.quiver(*places.T, *vectors.T, color=color, **scale, **look)
    # A key of rasterised arrows is drawn where it would be at their resolution.
    plain = {name: value for name, value in look.items() if name != "rasterized"}
    nothing = np.full((1, 4), np.nan)
    arrows = axes.quiver(*nothing.T, color=color, **scale, **plain)
    length = nice_below(0.1 * float(np.ptp(axes.get_xlim())) / factor)
    axes.quiverkey(
        arrows, key_at, 1.035, length, f"{word}{length:g} px", labelpos="W", coordinates="axes",
        labelsep=0.06, fontproperties={"size": 8},
    )  # fmt: skip


def _factor(length: float, drawn: float) -> float:
    return nice_below(drawn / length) if length > 0.0 else 1.0


def _words(sides: tuple[str, ...], fields: list[Field]) -> str:
    """Say whether the mean of a cell stands out of the noise."""
    if not any(len(field.cells) for field in fields):
        return "Too few corners to show a pattern of the residuals"
    loud = [
        f"{np.linalg.norm(field.means, axis=1).max():.2f} px ({side})"
        for side, field in zip(sides, fields, strict=True)
        if field.score > _STANDS_OUT
    ]
    if not loud:
        return "No pattern of the residuals stands out of the noise"
    return f"The residuals have a pattern of up to {' and '.join(loud)}"
