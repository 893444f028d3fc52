"""Two simulated cameras, the boards they saw, and photographs of the right size."""

from dataclasses import replace

import numpy as np

from nico_selfmodel.dataset.board_views import BoardViews
from nico_selfmodel.estimation.cameras.camera_assessment import CameraAssessment
from nico_selfmodel.estimation.cameras.camera_calibration import calibrate_cameras
from nico_selfmodel.estimation.cameras.camera_options import CameraOptions
from nico_selfmodel.geometry.rotation import rotation_from_vector
from nico_selfmodel.geometry.transform import apply, transform
from nico_selfmodel.model.cameras.camera import Camera
from nico_selfmodel.model.cameras.stereo_rig import StereoRig

SIZE = (320, 240)
SQUARE = 0.03
COLUMNS, ROWS = 5, 4
GRID = np.stack(np.meshgrid(np.arange(COLUMNS), np.arange(ROWS)), axis=-1).reshape(-1, 2)
P_GQ = SQUARE * np.column_stack([GRID, np.zeros(len(GRID))])
RIG = StereoRig(
    Camera(190.0, 191.0, 163.0, 116.0, SIZE, k1=-0.2, k2=0.03),
    Camera(
        189.0,
        190.0,
        157.0,
        122.0,
        SIZE,
        k1=-0.19,
        k2=0.03,
        X_WC=transform(rotation_from_vector([0.01, -0.03, 0.02]), [0.07, 0.001, -0.002]),
    ),
)
OUTLIER = "06"
LEFT_ALONE = "07"
UNSEEN = "99"


def boards(count, seed=0):
    """Return what both cameras see of boards, with 0.1 px of noise."""
    rng, pixels = np.random.default_rng(seed), []
    while len(pixels) < count:
        turn = rotation_from_vector(rng.normal(0.0, 0.35, 3))
        middle = rng.uniform([-0.2, -0.15, 0.2], [0.24, 0.15, 0.45])
        seen = RIG.project(apply(transform(turn, middle - turn @ P_GQ.mean(axis=0)), P_GQ))
        if ((seen >= 0.0) & (seen <= np.tile(SIZE, 2) - 1.0)).all():
            pixels.append(seen + rng.normal(0.0, 0.1, seen.shape))
    names = tuple(f"{v:02d}" for v in range(count))
    return BoardViews(P_GQ, names, ("left", "right"), np.array(pixels), (SIZE, SIZE))


def assessed(views, test=None, **options):
    """Return what calibrating from views is worth, with k3 held unless told otherwise."""
    options = CameraOptions(**{"pinned": {"k3": 0.0}} | options)
    return CameraAssessment.from_calibration(calibrate_cameras(views, options), options, test)


def flawed(views):
    """Return views with an outlier, a board that one camera saw alone, and lost corners."""
    pixels = views.pixels.copy()
    outlying = views.names.index(OUTLIER)
    pixels[outlying] += np.random.default_rng(4).normal(0.0, 3.0, pixels[outlying].shape)
    pixels[views.names.index(LEFT_ALONE), :, 2:] = np.nan
    pixels[2, :3] = np.nan
    return replace(views, pixels=pixels)


def photographs(names):
    """Return coloured noise: camera -> view -> red, green and blue."""
    rng, (width, height) = np.random.default_rng(9), SIZE
    return {
        camera: {name: rng.integers(40, 200, (height, width, 3), dtype=np.uint8) for name in names}
        for camera in ("left", "right")
    }
