"""A simulated Nico that has learned its arm and cameras by itself and now meets mirrors."""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from nico_selfmodel.estimation.arm.kinematics import calibrate_kinematics
from nico_selfmodel.estimation.body.stereo_points import StereoPoints
from nico_selfmodel.estimation.cameras.camera_calibration import calibrate_cameras
from nico_selfmodel.experiments.stereo import board_points
from nico_selfmodel.geometry.transform import inverse
from nico_selfmodel.model.cameras.mirror import Mirror
from nico_selfmodel.model.self_model import SelfModel
from nico_selfmodel.plant import ArmDescription
from nico_selfmodel.plant.kinematic_tree import KinematicTree
from nico_selfmodel.sessions.motion_capture_scenario import nominal_of
from nico_selfmodel.systems.simulated.mirrors import SimulatedMirrors

HEAD = {"neck_yaw": -1.0, "neck_pitch": 0.4, "eyes_tilt": 0.3}
"""The head looks at the right hand [rad]."""
MIRRORS: Mapping[str, Mirror] = {
    "near": Mirror.from_values([*np.radians([0.0, 4.0]), 0.42]),
    "middle": Mirror.from_values([*np.radians([6.0, -9.0]), 0.48]),
    "far": Mirror.from_values([*np.radians([-8.0, 5.0]), 0.60]),
}
"""Three poses of a mirror. The thesis' 106-144 mm from the left camera leave no room for a hand."""
BOARDS = 13
LEARNING_POSES = 160
"""Poses seen directly that the arm is learned from: the thesis' 60 on circles and 100 random."""


def mirror_body(
    seed: int,
    *,
    pixel_sigma: float = 0.3,
    play_deg: float = 0.5,
    radius: float | None = None,
) -> SimulatedMirrors:
    """Build a simulated Nico before mirrors.

    Args:
        pixel_sigma: Noise of each pixel coordinate [px].
        play_deg: Half the width of the joints' noise [deg].
        radius: Radius of curvature of the mirrors [m]; flat if omitted.
    """
    arm = ArmDescription.named("nico")
    tree = KinematicTree.from_urdf(arm.urdf)
    camera = tree.frame("left_wide_camera")
    X_BL = tree.poses({**arm.held, **HEAD}, arm.base_link, [camera])[0]
    return SimulatedMirrors(
        replace(arm, chain=arm.chain.moved(inverse(X_BL))),
        MIRRORS,
        seed,
        pixel_sigma=pixel_sigma,
        play=float(np.radians(play_deg)),
        radius=radius,
    )


def learned_body(body: SimulatedMirrors) -> SelfModel:
    """Let a body learn its cameras from boards and its arm from where they see its hand.

    Returns:
        Arm and cameras in the left camera's frame, without mirrors.
    """
    cameras = calibrate_cameras(body.look_at_boards(board_points(), BOARDS))
    seen = body.watch("", LEARNING_POSES, session=1, name="hand seen directly")
    stereo = StereoPoints.of(cameras.self_model("nico"), seen)
    nominal = nominal_of(ArmDescription.named("nico"))
    arm = calibrate_kinematics(stereo.train, nominal=nominal, name="nico", spread=stereo.spread)
    return replace(stereo.complete(arm).model, pixel_sigma=body.pixel_sigma)
