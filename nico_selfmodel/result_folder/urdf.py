"""The learned URDF of a result folder."""

import re
from pathlib import Path
from typing import TYPE_CHECKING

from nico_selfmodel.model.self_model import SelfModel

if TYPE_CHECKING:
    from nico_selfmodel.plant import ArmDescription

_LONGEST_NAME = 200  # of a robot in that of a file [bytes]


def urdf_file(
    model: SelfModel, folder: str | Path, robot: "ArmDescription | None"
) -> dict[str, str]:
    """Return the URDF of a model's arm as a file of its result folder.

    Args:
        model: The self-model.
        folder: Where the file will lie: relative mesh paths lead from there.
        robot: The robot that the arm belongs to; None where there is no description.

    Returns:
        `<robot>_learned.urdf` -> content; nothing for a model without an arm.

    Raises:
        ModelError: If the robot's file is gone, or has other joints.
    """
    if not model.has_arm:
        return {}
    from nico_selfmodel.plant import learned_urdf

    name = model.name if robot is None else Path(robot.robot).stem
    return {urdf_name(name): learned_urdf(model, robot, folder)}


def urdf_name(robot: str) -> str:
    """Return the name of a learned URDF, without what file systems or shells would stumble over.

    >>> urdf_name("../../my robot")
    'my_robot_learned.urdf'
    """
    plain = re.sub(r"[^\w.-]+", "_", robot).strip("._").encode()[:_LONGEST_NAME]
    return f"{plain.decode('utf-8', 'ignore') or 'robot'}_learned.urdf"
