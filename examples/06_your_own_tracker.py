"""Replace the tracker by any function from a picture to a pixel, or to why there is none."""

import numpy as np

from nico_selfmodel import NotSeen, VisibleWorkspace, commands_of_angles, record
from nico_selfmodel.systems import ImageQuality, NicoStation, StationBody, looking_arm


def middle_of_red(image):
    """Return the mean pixel of what is clearly red in a picture (blue, green, red)."""
    blue, green, red = np.moveaxis(image.astype(int), -1, 0)
    v, u = np.nonzero(red - np.maximum(blue, green) > 60)
    if len(u) < 20:
        return NotSeen(f"only {len(u)} red pixels")
    if min(u.min(), v.min()) == 0 or u.max() == image.shape[1] - 1 or v.max() == image.shape[0] - 1:
        return NotSeen("the red patch is cut by the border")
    return np.array([u.mean(), v.mean()])


arm = looking_arm("finger_tip")
with NicoStation(
    "thesis", 2, arm=arm, detectors={"finger_tip": middle_of_red}, quality=ImageQuality(1)
) as station:
    body = StationBody(station, station.joints, ("finger_tip",))
    poses = VisibleWorkspace.of(arm).random_poses(6, np.random.default_rng(0))
    commands = commands_of_angles(station.joints, arm.lower, arm.upper, poses)
    data = record(body, [("", c) for c in commands], "mine", image_size=station.image_size)
for encoders, pixels in zip(data.encoders, data.pixels, strict=True):
    print("encoders", encoders.astype(int), "pixels", pixels.round(1))
print(np.isfinite(data.pixels).all(axis=1).sum(), "poses seen by both cameras")
