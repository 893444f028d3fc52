"""A body as described whose head was learned: what it knows of itself before its arms."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.dataset.joint_info import JointInfo
from nico_selfmodel.errors import ModelError
from nico_selfmodel.geometry.rotation import rotation_about
from nico_selfmodel.geometry.transform import transform
from nico_selfmodel.model.tree.body_model import BodyModel
from nico_selfmodel.model.tree.body_tree import WORLD
from nico_selfmodel.names import listed
from nico_selfmodel.planning.plans import commands_of_angles
from nico_selfmodel.plant.body_description import BodyDescription


def with_known_head(
    body: BodyDescription, learned: BodyModel, joints: Sequence[JointInfo]
) -> BodyDescription:
    """Return a described body whose cameras, and what turns them, are as they were learned.

    Its angles are still those of the description, which `commands_of_angles` sends: shares of the
    joints' ranges. What sags is left out.

    Args:
        body: The robot as described, in the frame of its root link.
        learned: A body of its head, or of more, in the same world.
        joints: The robot's, with stops.

    Raises:
        ModelError: If a camera, or a joint that turns one, was not learned.
        ValueError: If such a joint has no stops, or is not commanded.
    """
    tree, known = body.tree, learned.tree
    mounts = [sensor.on for sensor in tree.sensors if sensor.on != WORLD]
    turning = np.flatnonzero(tree.beyond[mounts].any(axis=0)).tolist()
    head = [tree.joints[i] for i in turning]
    cameras = {sensor.name: sensor for sensor in known.sensors if sensor.name in known.lenses}
    wanted = [*head, *(sensor.name for sensor in tree.sensors)]
    if missing := [name for name in wanted if name not in (*known.joints, *cameras)]:
        raise ModelError(
            f"body {learned.name!r} lacks {listed(missing)}: learn it with "
            "`nico-selfmodel learn --head`"
        )
    own = [known.joints.index(name) for name in head]
    lower, upper = body.limits[:, turning]
    ends = commands_of_angles(_named(joints, head), lower, upper, np.stack([lower, upper]))
    low, high = ends * learned.si_per_unit[own] / known.gear[own]
    turn = (high - low) / (upper - lower)
    X_PJ, gears = tree.X_PJ.copy(), tree.gear.copy()
    X_PJ[turning] = known.X_PJ[own] @ _turns(low - turn * lower)
    gears[turning] = 1.0 / turn
    sensors = tuple(replace(sensor, X_LA=cameras[sensor.name].X_LA) for sensor in tree.sensors)
    lenses = {**tree.lenses, **{name: known.lenses[name] for name in cameras}}
    learned_tree = replace(tree, X_PJ=X_PJ, gear=gears, sensors=sensors, lenses=lenses)
    return replace(body, tree=learned_tree)


def _named(joints: Sequence[JointInfo], names: Sequence[str]) -> list[JointInfo]:
    """Return joints by their names.

    Raises:
        ValueError: If there is no such joint.
    """
    by_name = {joint.name: joint for joint in joints}
    if missing := [name for name in names if name not in by_name]:
        raise ValueError(
            f"the robot does not command {listed(missing)}, which turn the cameras; it commands "
            f"{listed(by_name)}"
        )
    return [by_name[name] for name in names]


def _turns(angles: NDArray) -> NDArray:
    """Return turns about z [rad]. Shape (m,) -> (m, 4, 4)."""
    about = rotation_about(np.broadcast_to([0.0, 0.0, 1.0], (len(angles), 3)), angles)
    return transform(about, np.zeros((len(angles), 3)))
