"""A simulated Nico that has learned its arm and eyes by itself and now meets mirrors."""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from nico_selfmodel.dataset import Dataset
from nico_selfmodel.estimation import calibrate_cameras, calibrate_kinematics
from nico_selfmodel.experiments.first_arm import nominal_of
from nico_selfmodel.experiments.stereo import board_points
from nico_selfmodel.geometry.transform import inverse
from nico_selfmodel.model import Mirror, ParameterCovariance, SelfModel, StereoRig
from nico_selfmodel.plant import ArmDescription
from nico_selfmodel.plant.kinematic_tree import KinematicTree
from nico_selfmodel.systems.simulated_mirror import SimulatedMirrors

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
    mirrors: Mapping[str, Mirror] = MIRRORS,
) -> SimulatedMirrors:
    """Build a simulated Nico before mirrors.

    Args:
        seed: Of the individual.
        pixel_sigma: Noise of each pixel coordinate [px].
        play_deg: Half the width of the joints' play [deg].
        radius: Radius of curvature of the mirrors [m]; flat if omitted.
        mirrors: Where the mirrors are meant to stand before the left eye.

    Returns:
        The body.
    """
    arm = ArmDescription.named("nico")
    tree = KinematicTree.from_urdf(arm.urdf)
    eye = tree.frame("left_wide_camera")
    X_BL = tree.poses({**arm.held, **HEAD}, arm.base_link, [eye])[0]
    return SimulatedMirrors(
        arm.chain.moved(inverse(X_BL)),
        (arm.lower, arm.upper),
        mirrors,
        seed,
        pixel_sigma=pixel_sigma,
        play=float(np.radians(play_deg)),
        radius=radius,
    )


def learned_body(body: SimulatedMirrors) -> SelfModel:
    """Let a body learn its eyes from boards and its arm from where they see its hand.

    Args:
        body: The simulated body.

    Returns:
        Arm and eyes in the left eye's frame, without mirrors.
    """
    eyes = calibrate_cameras(body.look_at_boards(board_points(), BOARDS))
    seen = body.watch("", LEARNING_POSES, session=1, name="hand seen directly")
    nominal = nominal_of(ArmDescription.named("nico"))
    learned = calibrate_kinematics(_with_points(seen, eyes.rig), nominal=nominal).model
    return replace(
        learned,
        name="nico",
        cameras={"left": eyes.rig.left, "right": eyes.rig.right},
        covariance=_together(learned.covariance, eyes.self_model("eyes").covariance),
        pixel_sigma=body.pixel_sigma,
    )


def _together(
    arm: ParameterCovariance | None, eyes: ParameterCovariance | None
) -> ParameterCovariance | None:
    """Return the covariance of arm and eyes, learned one after the other."""
    if arm is None or eyes is None:
        return arm or eyes
    split = len(arm.names)
    matrix = np.zeros((split + len(eyes.names),) * 2)
    matrix[:split, :split], matrix[split:, split:] = arm.matrix, eyes.matrix
    return ParameterCovariance((*arm.names, *eyes.names), matrix)


def _with_points(seen: Dataset, rig: StereoRig) -> Dataset:
    """Return the data with the hand's positions as stereo rebuilds them, in place of pixels."""
    usable = rig.left.has_rays(seen.pixels[:, :2]) & rig.right.has_rays(seen.pixels[:, 2:])
    seen = seen.select(np.asarray(usable))
    points = rig.triangulate(seen.pixels, seen.pixel_sigma_px or 1.0).p_WQ
    return replace(seen, p_WH_measured=points, pixels=None)
