"""Figures of lens and pair: distortion, epipolar errors, reconstruction by range."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from nico_selfmodel.estimation.cameras.camera_assessment import CameraAssessment
from nico_selfmodel.model.cameras.camera import Camera
from nico_selfmodel.model.cameras.projection import FISHEYE
from nico_selfmodel.viz.figures import palette
from nico_selfmodel.viz.figures.distribution_plot import distribution, error_sets
from nico_selfmodel.viz.figures.layout.plain_figure import PlainFigure
from nico_selfmodel.viz.figures.plot_style import HALF_WIDTH, MANY, headline, style

_STEPS = 200
_BAND = 2.0
"""Standard deviations in the shaded band."""
_MOST_BINS, _LEAST_IN_BIN = 8, 25


def distortion_profile(assessment: CameraAssessment) -> Figure:
    """Draw how far the lens moves a pixel, over its distance from the principal point."""
    calibration = assessment.calibration
    cameras = list(zip(calibration.views.cameras, calibration.cameras, strict=True))
    with style():
        figure = PlainFigure(figsize=(HALF_WIDTH, max(4.2, 1.8 * len(cameras))))
        panels = figure.subplots(len(cameras), 1, squeeze=False)[:, 0]
        words = []
        for axes, (side, camera) in zip(panels, cameras, strict=True):
            end = _profile_panel(axes, assessment, side, camera)
            words.append(f"{end:+.0f} px ({side})".replace("-", "−"))
        farthest = max(axes.get_xlim()[1] for axes in panels)
        for axes in panels:
            axes.set_xlim(0.0, farthest)
        panels[-1].set_xlabel("distance from the principal point [px]")
        headline(figure, f"Image corners are moved by {', '.join(words)}")
    return figure


def epipolar_distribution(assessment: CameraAssessment) -> Figure | None:
    """Draw how far corners lie from epipolar lines in each image; None for one camera."""
    if assessment.pair is None:
        return None
    calibration, test = assessment.calibration, None
    if assessment.test_views is not None:
        flat = assessment.test_views.pixels.reshape(-1, 4)
        both = flat[np.isfinite(flat).all(axis=1)]
        test = calibration.rig.epipolar_errors(both).ravel()
    train = assessment.pair.epipolar[~calibration.outliers].ravel()
    sets = error_sets(test, None, train[np.isfinite(train)])
    if not sets:
        return None
    what = "distance of a corner from its epipolar line"
    return distribution(sets, unit="px", what=what, thing="corner")


def reconstruction_by_range(assessment: CameraAssessment) -> Figure | None:
    """Draw the errors of rebuilt corners over their distance; None where nothing was rebuilt."""
    if assessment.pair is None or len(assessment.pair.reconstruction.views) == 0:
        return None
    found = assessment.pair.reconstruction
    distance, errors = 1e3 * found.depths.ravel(), 1e3 * found.errors.ravel()
    calibration = assessment.calibration
    with style():
        figure = PlainFigure(figsize=(HALF_WIDTH, 4.2))
        axes = figure.add_subplot()
        many = len(errors) > MANY
        axes.plot(
            distance, errors, ".", color=palette.MUTED, markersize=3.5, alpha=0.5, rasterized=many,
            label=f"corners ({len(errors)}) of {len(found.views)} boards",
        )  # fmt: skip
        middle, rms = _range_bins(distance, errors)
        look = {"color": palette.INK, "markersize": 4, "linewidth": 1.6}
        axes.plot(middle, rms, "o-", label="their rms", **look)
        z = np.linspace(0.97 * distance.min(), 1.03 * distance.max(), 50)
        focal = np.mean([(camera.fx + camera.fy) / 2.0 for camera in calibration.cameras])
        factor = calibration.pixel_sigma / (focal * 1e3 * calibration.rig.baseline)
        if np.isfinite(factor):
            sigma = f"σ = {calibration.pixel_sigma:.2f} px"
            text = f"expected of the depth: √2 z² σ / (f b), {sigma}"
            axes.plot(z, np.sqrt(2.0) * z**2 * factor, color=palette.HELD_OUT, label=text)
        axes.set_xlabel("distance from the left camera [mm]")
        axes.set_ylabel("error of a corner [mm]")
        axes.set_xlim(z[0], z[-1])
        axes.set_ylim(0.0, 1.03 * float(errors.max()) or 1.0)
        figure.legend(loc="outside lower left", ncols=1, handlelength=1.4)
        headline(figure, _range_words(distance, errors, assessment.test_views is not None))
    return figure


def _profile_panel(axes: Axes, assessment: CameraAssessment, side: str, camera: Camera) -> float:
    """Draw one camera's profile; return how far the lens moves the image's furthest corner [px]."""
    calibration = assessment.calibration
    focal = 0.5 * (camera.fx + camera.fy)
    center = np.array([camera.cx, camera.cy])
    size = np.array(camera.image_size, dtype=float)
    corners = np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0], [1.0, 1.0]]) * (size - 1.0)
    reach = float(np.linalg.norm(corners - center, axis=1).max())
    r = _radii_up_to(camera, reach / focal)
    moved = focal * (camera.profile(r)[0] - r)
    place = focal * r + moved
    sigma = _BAND * focal * _profile_sigma(assessment, side, r)
    color = palette.camera_colors(calibration.views.cameras)[side]
    pixels = calibration.views.of_camera(side)[~calibration.outliers].reshape(-1, 2)
    covered = float(np.nanmax(np.linalg.norm(pixels - center, axis=1), initial=0.0))
    axes.axvspan(0.0, covered, color=palette.FAINT, alpha=0.45, linewidth=0.0)
    axes.axhline(0.0, color=palette.MUTED, linewidth=0.8)
    if np.isfinite(sigma).all():
        axes.fill_between(
            place, moved - sigma, moved + sigma, color=color, alpha=0.25, linewidth=0.0
        )
    axes.plot(place, moved, color=color)
    # A lens that nothing tells of must not press the curve flat.
    span = max(float(np.ptp(moved)), 1.0)
    low, high = axes.get_ylim()
    axes.set_ylim(max(low, moved.min() - span), min(high, moved.max() + span))
    axes.axvline(reach, color=palette.MUTED, linewidth=0.9, linestyle=":")
    axes.annotate(
        "covered by corners", (covered, 1.0), xycoords=("data", "axes fraction"),
        xytext=(-4, -4), textcoords="offset points", ha="right", va="top", fontsize=7.5,
        color=palette.MUTED,
    )  # fmt: skip
    axes.set_xlim(0.0, 1.02 * reach)
    axes.set_ylabel(f"{side}: moved by [px]")
    band = f"band: ± {_BAND:g} σ; dotted: the image's corner"
    if camera.lens == FISHEYE:
        band = f"from an equidistant fisheye; {band}"
    axes.set_title(band, fontsize=7.5, fontweight="normal", color=palette.MUTED)
    return float(moved[-1])


def _radii_up_to(camera: Camera, distorted: float) -> NDArray:
    """Return `Camera.profile`'s radii from 0 to a distorted one, or to where the lens folds."""
    limit = min(camera.reach, 4.0 * distorted)
    r = np.linspace(0.0, limit, 20 * _STEPS)
    there = camera.profile(r)[0]
    past = np.flatnonzero(there > distorted)
    return np.linspace(0.0, r[past[0]] if len(past) else limit, _STEPS)


def _profile_sigma(assessment: CameraAssessment, side: str, r: NDArray) -> NDArray:
    """Return the standard deviation of the distorted radius, from that of k1, k2, ..."""
    calibration = assessment.calibration
    camera = calibration.cameras[calibration.views.cameras.index(side)]
    slopes = camera.profile(r)[1].T
    names = [f"{side}.k{power + 1}" for power in range(len(slopes))]
    free = [k for k, name in enumerate(names) if name in calibration.names]
    columns = [calibration.names.index(names[k]) for k in free]
    covariance = calibration.uncertainty.covariance[np.ix_(columns, columns)]
    return np.sqrt(np.einsum("ar,ab,br->r", slopes[free], covariance, slopes[free]))


def _range_bins(distance: NDArray, errors: NDArray) -> tuple[NDArray, NDArray]:
    """Return middle and root mean square of bins with equally many corners."""
    count = int(np.clip(len(errors) // _LEAST_IN_BIN, 1, _MOST_BINS))
    parts = np.array_split(np.argsort(distance, kind="stable"), count)
    middle = np.array([distance[rows].mean() for rows in parts])
    return middle, np.array([np.sqrt(np.mean(errors[rows] ** 2)) for rows in parts])


def _range_words(distance: NDArray, errors: NDArray, held_out: bool) -> str:
    kind = "held-out " if held_out else ""
    near, far = distance.min(), distance.max()
    return f"Rebuilt {kind}corners: {errors.mean():.2f} mm off at {near:.0f} to {far:.0f} mm"
