"""What a robot may assume of itself before it has learned anything."""

from collections.abc import Sequence

import numpy as np

from nico_selfmodel.dataset.joint_info import JointInfo
from nico_selfmodel.model.arm.dh_table import DhTable
from nico_selfmodel.model.arm.servo_map import ServoMap
from nico_selfmodel.model.cameras.stereo_rig import StereoRig
from nico_selfmodel.model.self_model import SelfModel
from nico_selfmodel.plant import ArmDescription


def first_guess(
    arm: ArmDescription, rig: StereoRig | None, joints: Sequence[JointInfo]
) -> SelfModel:
    """Return arm and cameras as described, with gears and zeros that follow from the joints' stops.

    Stops lie only near the description's limits.

    Args:
        rig: The cameras as described, in the frame of the arm's base; None where there are none.
        joints: The robot's joints, with stops.

    Returns:
        A self-model in the frame of the arm's base.

    Raises:
        ValueError: If a joint has no stops.
    """
    if any(joint.lower is None or joint.upper is None for joint in joints):
        raise ValueError("gears and zeros cannot be guessed of joints without stops")
    unit = np.array([joint.sign * joint.radians_per_unit for joint in joints])
    ends = np.array([[joint.lower, joint.upper] for joint in joints], dtype=float)
    low, high = np.sort(unit[:, None] * ends, axis=1).T
    gear = (high - low) / (arm.upper - arm.lower)
    servos = ServoMap(
        arm.joints,
        offset=low - gear * arm.lower,
        gear=gear,
        unit=tuple(joint.encoder_unit for joint in joints),
        counts_per_turn=np.array([joint.counts_per_turn or np.nan for joint in joints]),
        sign=np.array([float(joint.sign) for joint in joints]),
    )
    cameras = {} if rig is None else {"left": rig.left, "right": rig.right}
    table = DhTable.from_chain(arm.chain)
    return SelfModel("first guess", table, servos, robot=arm.source, cameras=cameras)
