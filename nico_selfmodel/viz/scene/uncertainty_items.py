"""How surely the hand is known, as an ellipsoid."""

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.estimation.arm.kinematics import KinematicCalibration
from nico_selfmodel.geometry.transform import transform
from nico_selfmodel.viz.figures import palette
from nico_selfmodel.viz.figures.numbers_shown import nice_factor, short
from nico_selfmodel.viz.scene.scene import LegendEntry
from nico_selfmodel.viz.scene.scene_items import Ellipsoid, Item

_DRAWN_RADIUS = 0.12
"""The longest half axis is drawn at most about this long."""


def uncertainty_items(calibration: KinematicCalibration, q: NDArray, unit: float) -> list[Item]:
    """Return the ellipsoid of one standard deviation of the predicted hand, larger than it is.

    Args:
        calibration: What was learned.
        q: Pose of the arm [rad]. Shape (n,).
        unit: Length that sizes are fractions of [m].

    Returns:
        One item under `uncertainty`, its path ending in the factor. None where nothing is known of
        the errors, or where unobservable directions would make it too small.
    """
    known = _principal_axes(calibration, q)
    if known is None:
        return []
    center, rotation, sigma = known
    factor = nice_factor(_DRAWN_RADIUS * unit, float(sigma.max()))
    # Hair-thin ellipsoids vanish: no half axis is drawn below a hundredth of the longest.
    radii = factor * np.maximum(sigma, 0.01 * sigma.max())
    ellipsoid = Ellipsoid(
        path=f"uncertainty/hand_1_sigma_x{factor:g}",
        color=palette.rgba(palette.UNCERTAINTY, 0.45),
        X_WI=transform(rotation, center),
        radii=radii,
    )
    return [ellipsoid]


def uncertainty_legend(
    calibration: KinematicCalibration, q: NDArray, unit: float
) -> list[LegendEntry]:
    """Return the factor, or why there is no ellipsoid."""
    color = palette.rgba(palette.UNCERTAINTY, 0.45)
    known = _principal_axes(calibration, q)
    if known is not None:
        largest = float(known[2].max())
        factor = nice_factor(_DRAWN_RADIUS * unit, largest)
        label = f"1σ of the predicted hand, drawn ×{factor:g} ({short(1e3 * largest)} mm at most)"
        return [LegendEntry(label, color)]
    if calibration.uncertainty is not None and calibration.uncertainty.unobservable:
        return [LegendEntry("no ellipsoid: some directions are unobservable", (0.0, 0.0, 0.0, 0.0))]
    return []


def _principal_axes(
    calibration: KinematicCalibration, q: NDArray
) -> tuple[NDArray, NDArray, NDArray] | None:
    """Return centre, rotation and standard deviations along its columns, or None."""
    uncertainty = calibration.uncertainty
    if uncertainty is None or uncertainty.unobservable:
        return None
    prediction = calibration.model.predict(calibration.model.servos.to_encoder(q))
    if prediction.covariance is None:
        return None
    variance, rotation = np.linalg.eigh(prediction.covariance[0])
    if not variance[-1] > 0.0:
        return None
    if np.linalg.det(rotation) < 0.0:
        rotation = rotation * np.array([1.0, 1.0, -1.0])
    return prediction.p_WH[0], rotation, np.sqrt(np.maximum(variance, 0.0))
