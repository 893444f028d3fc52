"""Nico's wide cameras as designed: their optics, and the links that carry them."""

import numpy as np

from nico_selfmodel.geometry.transform import transform
from nico_selfmodel.model.cameras.camera import Camera
from nico_selfmodel.model.cameras.stereo_rig import StereoRig

NICO_CAMERAS = StereoRig(
    Camera(381.0, 381.0, 319.5, 239.5, (640, 480), k1=-0.28, k2=0.09, k3=-0.012),
    Camera(
        381.0, 381.0, 319.5, 239.5, (640, 480), k1=-0.28, k2=0.09, k3=-0.012,
        X_WC=transform(np.eye(3), [0.07, 0.0, 0.0]),
    ),
)  # fmt: skip
"""80 degrees horizontally, 70 mm apart; the left one is the world."""
MOUNTS = ("left_wide_camera", "right_wide_camera")
"""Links that carry them."""
