"""What a simulated Nico's hands are marked with: fiducials, and tape about a finger."""

from pydrake.geometry import SceneGraph

from nico_selfmodel.plant import ArmDescription
from nico_selfmodel.plant.body_description import BodyDescription, built_frame_name
from nico_selfmodel.plant.model_in_plant import ModelInPlant
from nico_selfmodel.systems.rendering.station_scene import print_fiducial, wrap_tape
from nico_selfmodel.systems.stations.nico_detectors import FIDUCIALS
from nico_selfmodel.systems.tracking.hand_tracker import FIDUCIAL_ID


def mark_hands(
    scene_graph: SceneGraph, built: ModelInPlant, arm: ArmDescription | BodyDescription
) -> None:
    """Print fiducials and wrap tape where they belong."""
    if isinstance(arm, BodyDescription):
        for side, number in FIDUCIALS.items():
            mount, ball = f"{side}_hand_fiducial", f"{side}_wrist_marker"
            place = built_frame_name(mount)
            print_fiducial(scene_graph, built, mount, number, ball, place)
        wrap_tape(scene_graph, built, built_frame_name("right_finger_tip"))
        return
    if "fiducial" in arm.points:
        mount = arm.points["fiducial"]
        print_fiducial(scene_graph, built, mount, FIDUCIAL_ID, "right_wrist_marker")
    if "finger_tip" in arm.points:
        wrap_tape(scene_graph, built, arm.points["finger_tip"])
