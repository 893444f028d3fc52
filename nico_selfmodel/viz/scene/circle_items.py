"""Fitted circles with the samples they were fitted to, one colour a joint."""

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.estimation.arm.kinematics import KinematicCalibration
from nico_selfmodel.estimation.initialization.circle_points import CirclePointAnalysis, SweepCircle
from nico_selfmodel.geometry.rotation import tangent_basis
from nico_selfmodel.geometry.transform import apply
from nico_selfmodel.viz.figures import palette
from nico_selfmodel.viz.scene.scene import LegendEntry, path_names
from nico_selfmodel.viz.scene.scene_items import Item, Markers, Tube

_WIRE_RADIUS, _SAMPLE_RADIUS = 0.0035, 0.011
_CORNERS = 72
_SAME = 1.5
"""A circle that could not be carried is drawn where it fits its samples up to this factor."""


def circle_items(calibration: KinematicCalibration, unit: float) -> list[Item]:
    """Return circles and samples.

    Samples that several joints share (the home pose, the poses of a grid) are drawn once, apart.
    Outliers are drawn elsewhere.

    Args:
        unit: Length that sizes are fractions of [m].

    Returns:
        Items under `circles`, by joint.
    """
    if calibration.circles is None:
        return []
    items: list[Item] = []
    joints = path_names(calibration.model.joints)
    for k, circle in enumerate(calibration.circles.circles):
        placed = _placed_circle(calibration, calibration.circles, circle)
        if placed is not None:
            wire = Tube(
                path=f"circles/{joints[circle.joint]}/circle_{k}",
                color=palette.rgba(palette.joint_color(circle.joint), 0.85),
                points=placed,
                radius=_WIRE_RADIUS * unit,
                closed=True,
            )
            items.append(wire)
    for owner, rows in samples_by_owner(calibration).items():
        shared = owner < 0
        name = "shared_samples" if shared else f"{joints[owner]}/samples"
        color = palette.INK if shared else palette.joint_color(owner)
        samples = Markers(
            path=f"circles/{name}",
            color=palette.rgba(color),
            centers=calibration.train.observations.p_WH[rows],
            radius=_SAMPLE_RADIUS * unit,
        )
        items.append(samples)
    return items


def circle_legend(calibration: KinematicCalibration) -> list[LegendEntry]:
    """Return what the colours of circles and samples mean."""
    owners = samples_by_owner(calibration)
    if -1 not in owners:
        return []
    label = f"samples on the circles of several joints ({len(owners[-1])})"
    return [LegendEntry(label, palette.rgba(palette.INK))]


def samples_by_owner(calibration: KinematicCalibration) -> dict[int, NDArray]:
    """Return rows of the training data on circles, by joint; -1 holds those of several joints.

    Outliers are left out. Joints without a row are left out too.
    """
    owners: dict[int, set[int]] = {}
    if calibration.circles is not None:
        for circle in calibration.circles.circles:
            for row in circle.rows.tolist():
                owners.setdefault(row, set()).add(circle.joint)
    found: dict[int, list[int]] = {}
    for row in sorted(owners):
        if not calibration.outliers[row]:
            owner = next(iter(owners[row])) if len(owners[row]) == 1 else -1
            found.setdefault(owner, []).append(row)
    return {owner: np.array(found[owner]) for owner in sorted(found)}


def _placed_circle(
    calibration: KinematicCalibration, analysis: CirclePointAnalysis, sweep: SweepCircle
) -> NDArray | None:
    """Return corners of a circle where its samples were measured, or None. Shape (c, 3).

    The analysis holds circles at the zero configuration of its arm: they are carried out to the
    posture that the joints before held during the sweep. Without an arm there is nothing to carry
    with, and a circle is only drawn if it already lies on its samples.
    """
    circle = sweep.circle
    angle = np.arange(_CORNERS) * (2.0 * np.pi / _CORNERS)
    rim = np.stack([np.cos(angle), np.sin(angle)], axis=1) @ tangent_basis(circle.normal).T
    corners = circle.center + circle.radius * rim
    observations = calibration.train.observations
    if analysis.arm is not None:
        posture = analysis.arm.q_of(np.median(observations.angles[sweep.rows], axis=0))
        return apply(analysis.arm.chain.link_motions(posture)[sweep.joint], corners)
    off = circle.residuals_to(observations.p_WH[sweep.rows[sweep.inliers]])
    rms = float(np.sqrt(np.mean(np.sum(off**2, axis=1))))
    return corners if rms <= _SAME * circle.rms + 1e-9 else None
