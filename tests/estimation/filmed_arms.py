"""Arms that sag by physics, filmed by two cameras that also see boards."""

import numpy as np

from nico_selfmodel.dataset.dataset import Dataset
from nico_selfmodel.geometry.transform import apply, inverse
from nico_selfmodel.model.cameras.camera import Camera
from nico_selfmodel.model.self_model import SelfModel

from .sagging_arms import SaggingArm
from .simulated_trees import looking_at

EYE = Camera(900.0, 900.0, 640.0, 480.0, (1280, 960), k1=-0.05)
PLACES = ([2.6, -0.45, 0.9], [2.6, 0.45, 0.9])
TARGET = [0.0, 0.0, 0.6]


def eyes():
    """Cameras as the arm's world has them, and the self-model that knows them."""
    X_WL, X_WR = (looking_at(np.array(place), TARGET) for place in PLACES)
    cameras = {"left": EYE, "right": EYE.at(inverse(X_WL) @ X_WR)}
    return X_WL, SelfModel("eyes", cameras=cameras)


def filmed(arm: SaggingArm, rng, poses, *, sigma=0.15, span=1.0):
    """What both cameras see of an arm, and where its hand truly is in the left one's frame."""
    X_WL, model = eyes()
    data, true = arm.recorded(rng, poses, span=span, sigma=1e-9)
    p_LH = apply(inverse(X_WL), true)
    pixels = np.hstack([model.cameras[side].project(p_LH) for side in ("left", "right")])
    pixels += sigma * rng.normal(size=pixels.shape)
    return Dataset(
        "filmed",
        data.joints,
        data.sample,
        data.encoders,
        np.full(p_LH.shape, np.nan),
        pixels=pixels,
        marker=data.marker,
        pixel_sigma_px=sigma,
        image_size=EYE.image_size,
    ), p_LH
