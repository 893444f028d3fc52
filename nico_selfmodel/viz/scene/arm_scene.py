"""What a learned arm looks like: the arm, the data it was learned from, and how well it fits."""

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.dataset.sweeps import Sweep
from nico_selfmodel.estimation.arm.kinematics import KinematicCalibration
from nico_selfmodel.estimation.initialization.circle_points import crossing_of
from nico_selfmodel.geometry.transform import apply, transform
from nico_selfmodel.model.self_model import SelfModel
from nico_selfmodel.viz.figures import palette
from nico_selfmodel.viz.figures.numbers_shown import nice_factor, short
from nico_selfmodel.viz.scene.arm_items import arm_items, arm_legend
from nico_selfmodel.viz.scene.arm_shape import arm_length, joint_points
from nico_selfmodel.viz.scene.circle_items import circle_items, circle_legend
from nico_selfmodel.viz.scene.residual_items import (
    point_items,
    point_legend,
    residual_items,
    residual_legend,
)
from nico_selfmodel.viz.scene.robot.robot_items import robot_items, robot_legend
from nico_selfmodel.viz.scene.scene import LegendEntry, Scene
from nico_selfmodel.viz.scene.scene_items import Ellipsoid, Item, Tube
from nico_selfmodel.viz.scene.surroundings import camera_on, floor_items, turned, upright

if TYPE_CHECKING:
    from nico_selfmodel.plant import ArmDescription

_DRAWN_RADIUS = 0.12
"""The longest half axis is drawn at most about this long."""


def calibration_scene(
    calibration: KinematicCalibration, robot: "ArmDescription | None" = None
) -> Scene:
    """Describe a calibration as a scene.

    The arm stands in the pose that its sweeps share, or in the recorded pose nearest to the middle
    of the data. All is in the measuring frame W, turned until it stands upright where W is a
    camera.

    Args:
        robot: The robot that the arm belongs to, to be drawn around it.

    Returns:
        Arm, Denavit-Hartenberg frames, joint axes, circles with their samples, residuals, held-out
        points, outliers and the uncertainty of the hand.

    Raises:
        ModelError: If the robot cannot be read, or its chain has other joints.
    """
    q = shown_pose(calibration)
    unit = _length_unit(calibration)
    circles = circle_items(calibration, unit)
    items = [
        *arm_items(calibration.model, q, unit),
        *circles,
        *point_items(calibration, unit),
        *residual_items(calibration, unit),
        *uncertainty_items(calibration, q, unit),
    ]
    legend = (
        *arm_legend(calibration.model),
        *circle_legend(calibration),
        *point_legend(calibration),
        *residual_legend(calibration, unit),
        *uncertainty_legend(calibration, q, unit),
    )
    body: list[Item] = []
    if robot is not None:
        body = robot_items(robot, calibration.model, q)
        legend += tuple(robot_legend(robot))
    data, arm = _data_points(calibration), _arm_points(calibration.model, q, unit)
    wires = _small_circles(circles, np.concatenate([data, arm]))
    centers = [item.X_WI[None, :3, 3] for item in body]
    X_SW = upright(calibration.model, robot)
    points = apply(X_SW, np.concatenate([data, arm, *centers]))
    behind = np.concatenate(centers) if centers else arm
    front = X_SW[:3, :3] @ (data.mean(axis=0) - behind.mean(axis=0))
    view = camera_on(np.concatenate([points, *(apply(X_SW, wire) for wire in wires)]), front)
    floor = floor_items(points, unit, X_SW)
    parts = turned([*items, *body], X_SW)
    return Scene(calibration.model.name, (*floor, *parts), view, legend)


def shown_pose(calibration: KinematicCalibration) -> NDArray:
    """Return the joint displacements at which the arm is drawn [rad]. Shape (n,)."""
    observations = calibration.train.observations
    circles = () if calibration.circles is None else calibration.circles.circles
    sweeps = [Sweep(circle.joint, circle.rows) for circle in circles]
    servos = calibration.model.servos
    return (crossing_of(observations.angles, sweeps) - servos.offset) / servos.gear


def _length_unit(calibration: KinematicCalibration) -> float:
    """Return the length that sizes of drawn things are fractions of [m]."""
    size = calibration.train.observations.size
    return max(arm_length(calibration.model.chain), 0.5 * size)


def _data_points(calibration: KinematicCalibration) -> NDArray:
    """Return all measured points but the outliers, which may lie anywhere. Shape (N, 3)."""
    measured = [calibration.train.observations.p_WH[~calibration.outliers]]
    if calibration.test is not None:
        measured.append(calibration.test.p_WH_predicted)
    return np.concatenate(measured)


def _arm_points(model: SelfModel, q: NDArray, unit: float) -> NDArray:
    """Return the corners of boxes about the joints and the hand as drawn. Shape (k, 3)."""
    chain = model.chain.rezeroed(q)
    centers = np.concatenate([joint_points(chain), chain.p_WH_zero])
    corners = np.stack(np.meshgrid(*[(-1.0, 1.0)] * 3), axis=-1).reshape(-1, 3)
    return (centers[:, None] + 0.12 * unit * corners).reshape(-1, 3)


def _small_circles(items: list[Item], points: NDArray) -> list[NDArray]:
    """Return the corners of circles not larger than the rest: short arcs can make huge ones."""
    size = float(np.linalg.norm(np.ptp(points, axis=0)))
    wires = [item.points for item in items if isinstance(item, Tube)]
    return [p for p in wires if np.linalg.norm(np.ptp(p, axis=0)) <= size]


def uncertainty_items(calibration: KinematicCalibration, q: NDArray, unit: float) -> list[Item]:
    """Return the ellipsoid of one standard deviation of the predicted hand, larger than it is.

    Args:
        q: Pose of the arm [rad]. Shape (n,).
        unit: Length that sizes are fractions of [m].

    Returns:
        One item under `uncertainty`, its path ending in the factor; nothing where nothing is known
        of the errors, or where unobservable directions would make it too small.
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
