"""The thesis' own way to a mirror: each camera's reflected camera by itself, six parameters each.

Eq. 9.6-9.13 in their right form: the mean difference as the start of the plane, both cameras
reflected in it (without the printed half turn, see `model.cameras.mirror`), then each one
refined alone on its pixels. Beside one plane for both cameras it needs more poses, and the two
cameras lose their common baseline, as the thesis says itself.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.errors import NotIdentifiableError
from nico_selfmodel.estimation.mirrors.mirror_evaluation import MirrorEvaluation
from nico_selfmodel.estimation.mirrors.mirror_initialization import (
    mean_plane,
    rebuilt_points,
    virtual_points,
)
from nico_selfmodel.estimation.mirrors.reflections import Reflections
from nico_selfmodel.geometry.rotation import rotation_from_vector, rotation_vector_slope, skew
from nico_selfmodel.geometry.transform import apply, transform
from nico_selfmodel.model.cameras.camera import Camera
from nico_selfmodel.model.cameras.mirror import Mirror, mirror_camera
from nico_selfmodel.model.cameras.mirror_rig import projected
from nico_selfmodel.model.cameras.rig_parameters import POSE_NAMES
from nico_selfmodel.model.cameras.stereo_rig import StereoRig
from nico_selfmodel.optimization.calibration_program import CalibrationProgram

FEWEST_ROWS = 4
"""Points below which a camera's six parameters follow the noise."""


@dataclass(frozen=True, eq=False)
class MirrorCameras:
    """A reflected camera for each camera, learned independently."""

    cameras: tuple[Camera, ...]
    """They see real points where the cameras see reflections; their frames are left-handed."""

    def evaluate(self, reflections: Reflections) -> MirrorEvaluation:
        """Hold the cameras against reflections in the same mirror."""
        shown = projected(self.cameras, reflections.p_WQ)[0]
        # Cameras from few poses may have lost each other so far that some sights do not meet.
        rebuilt = rebuilt_points(StereoRig(*self.cameras), reflections.pixels)
        rebuilt = apply(reflections.cameras[0].X_CW, rebuilt)
        return MirrorEvaluation(reflections, reflections.pixels - shown, rebuilt)


def fit_mirror_cameras(reflections: Reflections) -> MirrorCameras:
    """Learn both reflected cameras as the thesis does.

    Args:
        reflections: Of one mirror, seen by both cameras.

    Raises:
        NotIdentifiableError: If fewer than `FEWEST_ROWS` rows were seen by both cameras.
    """
    virtual = virtual_points(reflections)
    both = np.isfinite(virtual).all(axis=1)
    if both.sum() < FEWEST_ROWS:
        raise NotIdentifiableError(
            f"{int(both.sum())} reflections seen by both cameras are too few for two cameras with "
            f"six parameters each, at least {FEWEST_ROWS} are needed"
        )
    start = Mirror.from_plane(mean_plane(reflections.p_LQ[both], virtual[both]))
    plane = start.plane_in(reflections.cameras[0].X_WC)
    cameras = []
    for c, camera in enumerate(reflections.cameras):
        pixels = reflections.pixels[:, 2 * c : 2 * c + 2]
        rows = np.isfinite(pixels).all(axis=1)
        block = _PoseResiduals(mirror_camera(camera, plane), pixels[rows], reflections.p_WQ[rows])
        program = CalibrationProgram()
        program.add_variables(block.names, np.zeros(6))
        program.add_residuals(block)
        cameras.append(block.camera(program.solve().x))
    return MirrorCameras(tuple(cameras))


class _PoseResiduals:
    """Pixels of one camera over its pose, in a chart about where it started (thesis eq. 9.13)."""

    names: tuple[str, ...] = POSE_NAMES

    def __init__(self, start: Camera, pixels: NDArray, p_WQ: NDArray) -> None:
        self.start, self.pixels, self.p_WQ = start, pixels, p_WQ

    def camera(self, x: NDArray) -> Camera:
        """Return the camera turned and moved by x = (w, t)."""
        turned = rotation_from_vector(x[:3]) @ self.start.X_WC[:3, :3]
        return self.start.at(transform(turned, self.start.X_WC[:3, 3] + x[3:]))

    def evaluate(self, x: NDArray) -> tuple[NDArray, NDArray]:
        """Return residuals, shape (2, N), and derivatives, shape (6, 2, N)."""
        camera = self.camera(x)
        pixels, by_point = projected((camera,), self.p_WQ)
        by_turn = by_point @ skew(self.p_WQ - camera.X_WC[:3, 3]) @ rotation_vector_slope(x[:3])
        jacobian = np.concatenate([by_turn, -by_point], axis=2)
        return (pixels - self.pixels).T, np.transpose(jacobian, (2, 1, 0))
