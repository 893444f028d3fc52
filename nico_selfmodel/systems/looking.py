"""Nico looking at its hands: which joints stand still, and which points it sees."""

from collections.abc import Mapping, Sequence
from functools import cache

import numpy as np

from nico_selfmodel.names import listed
from nico_selfmodel.plant import ArmDescription
from nico_selfmodel.plant.body_description import BodyDescription
from nico_selfmodel.systems.nico_cameras import MOUNTS, NICO_CAMERAS

LOOKING_DEG = {
    "neck_yaw": -40.0,
    "neck_pitch": 0.0,
    "eyes_tilt": 30.0,
    "right_forearm_twist": -90.0,
    "right_wrist": 0.0,
    "right_index": 0.0,
    "right_fingers": 0.0,
}
"""Joints that stand still: the hand turns its back to the head, which looks at where it works. Half
turned to the right and with the cameras down it sees both of the hand's markers in 6 of 100 random
poses; straight ahead with the head bowed (yaw -10, pitch 25, tilt 20 deg) it is 1.4."""
MARKER_FRAMES = {
    "fiducial": "right_hand_fiducial",
    "finger_tip": "right_finger_tip",
    "hand": "right_wrist_marker",
}
"""What cameras and motion capture can track on the hand: marker -> link or frame it sits on."""
FINGER = "right_index_finger"
"""Link of the finger that touches things."""


def looking() -> dict[str, float]:
    """Return the joints that stand still while Nico looks at its right hand [rad]."""
    return {joint: float(np.radians(angle)) for joint, angle in LOOKING_DEG.items()}


@cache
def looking_arm(*markers: str) -> ArmDescription:
    """Return Nico's right arm of four joints, with the head turned to look at the hand.

    Args:
        markers: Some of `MARKER_FRAMES`; all of them by default.

    Raises:
        ValueError: If there is no such point.
    """
    return _right_arm(looking(), markers)


@cache
def touching_arm(*markers: str) -> ArmDescription:
    """Return Nico's right arm of six joints, which brings its finger to the face.

    Args:
        markers: As in `looking_arm`, which says what is raised too.
    """
    own = ARM_JOINTS["right"]
    held = {joint: angle for joint, angle in looking().items() if joint not in own}
    return _right_arm(held, markers)


def _right_arm(held: Mapping[str, float], markers: tuple[str, ...]) -> ArmDescription:
    unknown = set(markers) - set(MARKER_FRAMES)
    if unknown:
        raise ValueError(f"no point {sorted(unknown)}; there are {', '.join(MARKER_FRAMES)}")
    points = {marker: MARKER_FRAMES[marker] for marker in markers or MARKER_FRAMES}
    return ArmDescription.from_urdf("nico", "chest", "right_hand", dict(held), points)


HEAD_JOINTS = (
    "neck_yaw", "neck_pitch", "neck_roll", "eyes_tilt", "left_eye_pan", "right_eye_pan",
)  # fmt: skip
"""Joints that turn the cameras."""
TORSO_JOINTS, NECK_JOINTS = ("torso_yaw", "torso_pitch"), ("neck_yaw", "neck_pitch")
"""Joints that turn the cameras and all of the body before them, or the head alone."""
ARM_JOINTS = {
    side: tuple(
        f"{side}_{joint}"
        for joint in (
            "shoulder_pitch", "shoulder_roll", "upper_arm_twist", "elbow", "forearm_twist", "wrist",
        )
    )
    for side in ("right", "left")
}  # fmt: skip
"""All joints of each arm."""
ALL_JOINTS = (*HEAD_JOINTS, *ARM_JOINTS["right"], *ARM_JOINTS["left"])
"""All joints that a whole Nico commands, in their order."""
HAND_POINTS = {
    f"{side}_{point}": card
    for side in ARM_JOINTS
    for point, card in (("hand_fiducial", True), ("finger_tip", False), ("wrist_marker", False))
}
"""Links whose origins cameras and motion capture can track on both hands, and whether they are
cards."""


@cache
def looking_body(*joints: str) -> BodyDescription:
    """Return Nico's whole body: head, arms of six joints each, both cameras.

    Args:
        joints: Those that are commanded; all of them by default. The others stand as `looking`
            has them, or at zero.

    Raises:
        ModelError: If there is no such joint.
    """
    return _whole_body(ALL_JOINTS, joints or ALL_JOINTS)


@cache
def turning_body() -> BodyDescription:
    """Return Nico's whole body on a torso that turns: torso, neck and right arm are commanded."""
    return _whole_body(
        (*TORSO_JOINTS, *ALL_JOINTS), (*TORSO_JOINTS, *NECK_JOINTS, *ARM_JOINTS["right"])
    )


def _whole_body(joints: Sequence[str], commanded: Sequence[str]) -> BodyDescription:
    cameras = dict(zip(MOUNTS, NICO_CAMERAS.cameras, strict=True))
    return BodyDescription.from_urdf(
        "nico", joints, HAND_POINTS, cameras, commanded=commanded, held=looking()
    )


def arms_among(joints: Sequence[str]) -> tuple[str, ...]:
    """Return the arms among a body's joints, which are those of its head and of whole arms.

    Raises:
        ValueError: If a whole Nico does not command one, or some are missing or in another order.
    """
    if strange := [joint for joint in joints if joint not in ALL_JOINTS]:
        raise ValueError(
            f"the body has the joints {listed(strange)}, which this robot does not command; it "
            f"commands {listed(ALL_JOINTS)}"
        )
    arms = tuple(side for side, own in ARM_JOINTS.items() if set(own) & set(joints))
    wanted = (*HEAD_JOINTS, *(joint for side in arms for joint in ARM_JOINTS[side]))
    if missing := [joint for joint in wanted if joint not in joints]:
        raise ValueError(
            f"the body lacks {listed(missing)}: a head and whole arms are moved, as `learn --head` "
            "leaves them"
        )
    if tuple(joints) != wanted:
        raise ValueError(
            f"the body has its joints in the order {listed(joints)}, expected {listed(wanted)}"
        )
    return arms
