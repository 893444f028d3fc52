"""The self-model as a Drake plant, and the robots it may belong to."""

from nico_selfmodel.plant.description import ArmDescription, LinkPoses
from nico_selfmodel.plant.learned_frames import LearnedFrames, learned_frames
from nico_selfmodel.plant.robots import ROBOTS, NamedArm, find_robot, named_arm
from nico_selfmodel.plant.self_model_plant import SelfModelPlant, hand_frame_name
from nico_selfmodel.plant.urdf_export import MEASURING_FRAME, learned_urdf

__all__ = [
    "MEASURING_FRAME",
    "ROBOTS",
    "ArmDescription",
    "LearnedFrames",
    "LinkPoses",
    "NamedArm",
    "SelfModelPlant",
    "find_robot",
    "hand_frame_name",
    "learned_frames",
    "learned_urdf",
    "named_arm",
]
