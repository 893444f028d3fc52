"""Figures of what cameras saw: errors, where corners lie in the images, which views fit badly."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Patch, Rectangle
from numpy.typing import NDArray

from nico_selfmodel.estimation.cameras.camera_assessment import CameraAssessment
from nico_selfmodel.viz.figures import palette
from nico_selfmodel.viz.figures.camera_views import USE_COLORS, USES, ShownView
from nico_selfmodel.viz.figures.distribution_plot import distribution, error_sets
from nico_selfmodel.viz.figures.layout.plain_figure import PlainFigure
from nico_selfmodel.viz.figures.numbers_shown import short
from nico_selfmodel.viz.figures.plot_style import (
    FULL_WIDTH,
    HALF_WIDTH,
    MANY,
    grid_along,
    headline,
    log_ticks,
    style,
)

_CELLS = 8
"""Of the longer side of an image."""
_LOG_FROM = 8.0


def pixel_errors(assessment: CameraAssessment) -> Figure:
    """Draw the distribution of reprojection errors: held out, cross-validated and learned from."""
    sets = error_sets(
        assessment.test_distances, assessment.cross_validation, assessment.train_distances
    )
    return distribution(sets, unit="px", what="reprojection error", thing="corner")


def coverage(assessment: CameraAssessment) -> Figure:
    """Draw where in each image there were corners, and where there were none."""
    views = assessment.calibration.views
    inliers = ~assessment.calibration.outliers
    with style():
        figure, panels = image_panels(assessment)
        shares, empty_corners = [], 0
        for axes, side in zip(panels, views.cameras, strict=True):
            pixels = views.of_camera(side)[inliers].reshape(-1, 2)
            pixels = pixels[np.isfinite(pixels).all(axis=1)]
            counts, u, v = cell_counts(pixels, views.size_of(side))
            shares.append(f"{100.0 * np.mean(counts > 0):.0f} %")
            empty_corners += int(np.sum(counts[[0, 0, -1, -1], [0, -1, 0, -1]] == 0))
            _density(axes, side, counts, u, v)
            many = len(pixels) > MANY
            color = palette.camera_colors(views.cameras)[side]
            axes.plot(*pixels.T, ".", color=color, markersize=2.6, alpha=0.8, rasterized=many)
            axes.set_title(f"{side}: {len(pixels)} corners")
        stripes = {"facecolor": "white", "hatch": "////"}
        handles = [
            Patch(**stripes, edgecolor=palette.FAINT, label="no corner in this cell"),
            Patch(
                **stripes,
                edgecolor=palette.CROSS_VALIDATION,
                label="nor in this corner of the image",
            ),
        ]
        figure.legend(handles=handles, loc="outside lower left", ncols=2)
        headline(figure, _coverage_words(views.cameras, shares, 4 * len(panels) - empty_corners))
    return figure


def view_errors(views: tuple[ShownView, ...]) -> Figure:
    """Draw the rms of every view and of each camera in it."""
    shown = [view for view in views if view.rms is not None]
    with style():
        figure = PlainFigure(figsize=(HALF_WIDTH, 3.4))
        axes = figure.add_subplot()
        values = np.array([view.rms for view in shown], dtype=float)
        for use in USES[:3]:
            rows = [k for k, view in enumerate(shown) if view.use == use]
            if rows:
                axes.bar(
                    rows, values[rows], 0.74, color=USE_COLORS[use], label=f"{use} ({len(rows)})"
                )
        many = len(shown[0].cameras)
        colors = palette.camera_colors([camera.side for camera in shown[0].cameras])
        for k, camera in enumerate(shown[0].cameras if many > 1 else ()):
            one = [np.nan if v.cameras[k].rms is None else v.cameras[k].rms for v in shown]
            mark = {
                "color": colors[camera.side],
                "markeredgecolor": "white",
                "markersize": 7,
            }
            at = np.arange(len(shown)) + 0.32 * (k / (many - 1) - 0.5)
            axes.plot(at, one, "o", label=f"{camera.side} camera alone", **mark)
        if values.max() > _LOG_FROM * np.median(values):
            axes.set_yscale("log")
            log_ticks(axes.yaxis)
        turned = {"rotation": 90} if len(shown) * max(len(v.name) for v in shown) > 110 else {}
        axes.set_xticks(range(len(shown)), [view.name for view in shown], **turned)
        axes.tick_params(axis="x", length=0)
        axes.set_xlim(-0.6, len(shown) - 0.4)
        axes.set_xlabel("view")
        axes.set_ylabel("rms [px]")
        grid_along(axes, "y")
        figure.legend(loc="outside lower left", ncols=3, handlelength=1.2)
        worst = shown[int(np.argmax(values))]
        ratio = float(values.max() / np.median(values))
        headline(
            figure,
            f"Worst view: {worst.name} with {values.max():.2f} px rms, {short(ratio)} times the "
            "median view",
        )
    return figure


def _coverage_words(sides: tuple[str, ...], shares: list[str], reached: int) -> str:
    """Say how much of the images is covered, and how many of their own corners."""
    if len(sides) == 1:
        return f"{shares[0]} of the image is covered, and {reached} of its 4 corners"
    if len(sides) > 2:
        least = min(shares, key=lambda share: float(share.split()[0]))
        of_all = f"{reached} of their {4 * len(sides)} corners"
        return f"At least {least} of each image is covered, and {of_all}"
    first, second = (f"{share} of the {side}" for share, side in zip(shares, sides, strict=True))
    return f"{first} and {second} image is covered, and {reached} of their 8 corners"


def image_panels(assessment: CameraAssessment) -> tuple[Figure, list[Axes]]:
    """Return a figure with one panel a camera, laid out as its image."""
    views = assessment.calibration.views
    sides, sizes = views.cameras, views.image_sizes
    columns = len(sides) if len(sides) <= 3 else 2 if len(sides) == 4 else 3
    rows = -(-len(sides) // columns)
    inches = FULL_WIDTH if len(sides) > 1 else HALF_WIDTH
    panel = (inches - 0.6 * columns) / columns
    tall = max(height / width for width, height in sizes)
    figure = PlainFigure(figsize=(inches, 0.75 + rows * (0.6 + panel * tall)))
    # Down the columns, which narrow pages show one below the other.
    every = list(figure.subplots(rows, columns, squeeze=False).T.ravel())
    for unused in every[len(sides) :]:
        unused.set_axis_off()
    panels = every[: len(sides)]
    for axes, (width, height) in zip(panels, sizes, strict=True):
        axes.set_xlim(-0.03 * width, 1.03 * width)
        axes.set_ylim(1.03 * height, -0.03 * height)
        axes.set_aspect("equal")
        axes.grid(False)
        outline = Rectangle((-0.5, -0.5), width, height, fill=False, edgecolor=palette.INK)
        axes.add_patch(outline)
        for spine in axes.spines.values():
            spine.set_visible(False)
        axes.set_xlabel("u [px]")
        axes.set_ylabel("v [px]")
    return figure, panels


def cell_counts(pixels: NDArray, image_size: tuple[int, int]) -> tuple[NDArray, NDArray, NDArray]:
    """Return how many pixels lie in each cell of an image, (columns, rows), and its borders."""
    width, height = image_size
    side = max(width, height) / _CELLS
    u = np.linspace(-0.5, width - 0.5, max(round(width / side), 2) + 1)
    v = np.linspace(-0.5, height - 0.5, max(round(height / side), 2) + 1)
    return np.histogram2d(*pixels.T, bins=(u, v))[0], u, v


def _density(axes: Axes, side: str, counts: NDArray, u: NDArray, v: NDArray) -> None:
    """Shade cells by how many corners lie in them, and hatch those that have none."""
    look = {
        "cmap": "Greys",
        "vmin": 0.0,
        "vmax": 3.0 * max(counts.max(), 1.0),
        "gid": f"shade_{side}",
    }
    axes.pcolormesh(u, v, counts.T, **look)
    last = np.array(counts.shape) - 1
    for i, j in np.argwhere(counts == 0).tolist():
        corner = i in (0, last[0]) and j in (0, last[1])
        axes.add_artist(  # not as a patch, by which it would ask how far the panel reaches
            Rectangle(
                (u[i], v[j]),
                u[i + 1] - u[i],
                v[j + 1] - v[j],
                facecolor="white",
                edgecolor=palette.CROSS_VALIDATION if corner else palette.FAINT,
                hatch="////",
                linewidth=0.0,
                gid=f"shade_{side}_{i}_{j}",
            )
        )
