"""What a learned body looks like: arm, cameras, and how surely it knows where its hand is."""

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.estimation.body.body_calibration import BodyCalibration
from nico_selfmodel.estimation.body.workspace_accuracy import WorkspaceAccuracy, workspace_accuracy
from nico_selfmodel.geometry.transform import apply
from nico_selfmodel.model.self_model import SelfModel
from nico_selfmodel.viz.figures import palette
from nico_selfmodel.viz.scene.arm_items import arm_items, arm_legend
from nico_selfmodel.viz.scene.arm_shape import arm_length
from nico_selfmodel.viz.scene.camera_items import ImagePlane, camera_items
from nico_selfmodel.viz.scene.robot.robot_items import robot_items, robot_legend
from nico_selfmodel.viz.scene.scene import LegendEntry, Scene
from nico_selfmodel.viz.scene.scene_items import Item, Markers, Needles
from nico_selfmodel.viz.scene.surroundings import camera_from, floor_items, upright

if TYPE_CHECKING:
    from nico_selfmodel.plant import ArmDescription

_DOT = 0.003
_PLANE = 0.05
"""Distance of image planes from their cameras [m]."""
_ENLARGED = 10.0
"""Residuals are drawn this many times as long."""
_AZIMUTH, _ELEVATION = np.radians(250.0), np.radians(30.0)


def body_scene(calibration: BodyCalibration, robot: "ArmDescription | None" = None) -> Scene:
    """Describe a learned body as a scene; z is up, and the left camera stands at its origin.

    Args:
        robot: The robot that the arm belongs to, to be drawn around it. It stands as it does;
            without it the left camera looks along x.

    Returns:
        The arm at the training pose nearest to their middle, both cameras, the hand at every
        training pose in the colour of its whole uncertainty, and its distance from where the
        cameras saw it, tenfold.

    Raises:
        ModelError: If the robot cannot be read, or its chain has other joints.
    """
    accuracy = accuracy_at(calibration)
    X_SW = upright(calibration.model, robot)
    body = standing(calibration.model, X_SW)
    q = _middle_pose(calibration)
    hands = _hands(calibration, accuracy, X_SW)
    return with_body(
        body, q, hands, X_SW, calibration.train.p_LH_predicted, _legend(accuracy), robot
    )


def with_body(
    body: SelfModel,
    q: NDArray,
    items: list[Item],
    X_SW: NDArray,
    p_WH: NDArray,
    legend: list[LegendEntry],
    robot: "ArmDescription | None",
) -> Scene:
    """Return a scene of an arm, its cameras, its robot and whatever belongs to them.

    Args:
        body: The body, standing in the scene.
        q: Its pose [rad]. Shape (n,).
        items: What else is shown, in the scene.
        X_SW: Pose of the body's own world in the scene. Shape (4, 4).
        p_WH: Places of the hand that must be in view, in that world [m]. Shape (N, 3).
        legend: What the items are.
        robot: The robot that the arm belongs to, to be drawn around it.

    Raises:
        ModelError: If the robot cannot be read, or its chain has other joints.
    """
    unit = arm_length(body.chain)
    shell = [] if robot is None else robot_items(robot, body, q)
    points = np.concatenate(
        [
            apply(X_SW, p_WH),
            body.chain.rezeroed(q).points,
            *(camera.X_WC[None, :3, 3] for camera in body.cameras.values()),
            *(item.X_WI[None, :3, 3] for item in shell),
        ]
    )
    parts = [*arm_items(body, q, unit), *_cameras(body), *items, *shell]
    entries = (*arm_legend(body), *legend, *(robot_legend(robot) if robot else ()))
    view = camera_from(points, float(_AZIMUTH), float(_ELEVATION))
    return Scene(body.name, (*floor_items(points, unit, X_SW), *parts), view, entries)


def accuracy_at(calibration: BodyCalibration) -> WorkspaceAccuracy:
    """Return how surely the hand is known at the training poses."""
    arm = calibration.train.observations.arm
    model = calibration.model
    return workspace_accuracy(model, arm.angles / model.servos.radians_per_unit)


def standing(model: SelfModel, X_SW: NDArray) -> SelfModel:
    """Return a body in a scene's frame.

    Args:
        X_SW: Pose of its world in the scene. Shape (4, 4).
    """
    table = replace(model.dh, X_W0=X_SW @ model.dh.X_W0)
    cameras = {name: camera.at(X_SW @ camera.X_WC) for name, camera in model.cameras.items()}
    return replace(model, table=table, cameras=cameras, covariance=None)


def _middle_pose(calibration: BodyCalibration) -> NDArray:
    """Return the joint displacements of the training pose nearest to the middle [rad]."""
    servos = calibration.model.servos
    q = (calibration.train.observations.arm.angles - servos.offset) / servos.gear
    return q[middle_row(q)]


def middle_row(q: NDArray) -> int:
    """Return the row of the pose nearest to the middle of poses. Shape (N, n)."""
    return int(np.argmin(np.sum((q - np.median(q, axis=0)) ** 2, axis=1)))


def _cameras(model: SelfModel) -> list[Item]:
    return [
        item
        for name, camera in model.cameras.items()
        for item in camera_items(name, ImagePlane(camera, _PLANE), None)
    ]


def _hands(calibration: BodyCalibration, accuracy: WorkspaceAccuracy, X_SW: NDArray) -> list[Item]:
    """Return the hand at every pose, and where the cameras saw it."""
    train, inliers = calibration.train, ~calibration.outliers
    predicted = apply(X_SW, train.p_LH_predicted)
    seen = apply(X_SW, train.p_LH_seen)
    colors = palette.error_colors(accuracy.total, float(accuracy.total.max()))
    items: list[Item] = [
        Markers(
            path="hand/known_to",
            color=palette.rgba(palette.HAND),
            centers=predicted[inliers],
            colors=colors[inliers],
            radius=_DOT,
        )
    ]
    both = np.isfinite(seen).all(axis=1)
    if (both & inliers).any():
        rows = both & inliers
        items.append(
            Needles(
                path="hand/residuals_tenfold",
                color=palette.rgba(palette.MUTED, 0.7),
                starts=predicted[rows],
                ends=(predicted + _ENLARGED * (seen - predicted))[rows],
                radius=0.25 * _DOT,
            )
        )
    if (both & ~inliers).any():
        items.append(
            Markers(
                path="hand/outliers",
                color=palette.rgba(palette.OUTLIER),
                centers=seen[both & ~inliers],
                radius=_DOT,
            )
        )
    return items


def _legend(accuracy: WorkspaceAccuracy) -> list[LegendEntry]:
    colors = palette.scale(palette.ERRORS)
    return [
        LegendEntry(f"hand known to 0 ... {1e3 * accuracy.total.max():.1f} mm", colors[-1], colors),
        LegendEntry("where the cameras saw it, tenfold", palette.rgba(palette.MUTED, 0.7)),
        LegendEntry("left camera", palette.rgba(palette.CAMERAS["left"])),
        LegendEntry("right camera", palette.rgba(palette.CAMERAS["right"])),
        LegendEntry("outliers", palette.rgba(palette.OUTLIER)),
    ]
