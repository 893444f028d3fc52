"""Which way is up: what was learned by sight lives in the left eye's frame, where y points down."""

from collections.abc import Iterable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.geometry.transform import transform
from nico_selfmodel.model import SelfModel
from nico_selfmodel.plant import ArmDescription, learned_frames
from nico_selfmodel.viz.scene_items import Item

X_WL = np.array(
    [[0.0, 0.0, 1.0, 0.0], [-1.0, 0.0, 0.0, 0.0], [0.0, -1.0, 0.0, 0.0], [0.0, 0.0, 0.0, 1.0]]
)
"""Pose of an eye in a scene that is about eyes: it looks along x, and z is up."""


def upright(model: SelfModel, robot: ArmDescription | None = None) -> NDArray:
    """Return the pose of a model's world in a scene whose z is up. Shape (4, 4).

    Only a model whose world is its left eye needs to be turned: others were measured by something
    that stood upright itself. Its robot knows how it stands; without one the eye is taken as level.

    Args:
        model: The self-model.
        robot: The robot that the arm belongs to.

    Raises:
        ModelError: If the robot cannot be read, or its chain has other joints.
    """
    left = model.cameras.get("left")
    if left is None or not np.allclose(left.X_WC, np.eye(4), atol=1e-12):
        return np.eye(4)
    if robot is None or not model.has_arm:
        return X_WL
    X_WR = learned_frames(robot, model.chain).X_WR
    return transform(X_WR[:3, :3].T, np.zeros(3))


def turned(items: Iterable[Item], X_SW: NDArray) -> list[Item]:
    """Return items of a world in a scene.

    Args:
        items: As in the world.
        X_SW: Pose of the world in the scene. Shape (4, 4).
    """
    return [replace(item, X_WI=X_SW @ item.X_WI) for item in items]
