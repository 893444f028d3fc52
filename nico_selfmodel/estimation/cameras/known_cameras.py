"""Cameras as they were known before, held against the boards that others are learned from."""

from collections.abc import Iterable
from dataclasses import dataclass
from itertools import combinations
from typing import Any

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.dataset.board_views import BoardViews
from nico_selfmodel.errors import DataError, ModelError
from nico_selfmodel.estimation.cameras.board_accuracy import corner_distances, held_out_residuals
from nico_selfmodel.estimation.cameras.camera_adjustment import CameraCalibration
from nico_selfmodel.estimation.cameras.pair_checks import baseline
from nico_selfmodel.estimation.results.calibration_result import Errors
from nico_selfmodel.estimation.results.model_changes import parameter_changes
from nico_selfmodel.geometry.transform import inverse
from nico_selfmodel.model.cameras.camera import Camera
from nico_selfmodel.model.self_model import SelfModel
from nico_selfmodel.names import listed

_SCALE = 0.01
"""Share by which cameras stand further apart than they were known to before a square is
suspected."""

_TOLD = 5.0
"""Standard deviations of how far they stand apart that it must be, too."""


@dataclass(frozen=True, eq=False)
class KnownCameras:
    """What cameras that were known before leave unexplained of some boards."""

    model: SelfModel
    """They alone, the first one at the world."""
    held_out: bool
    """Whether the boards were held out, or learned from."""
    residuals: NDArray
    """Measured minus predicted pixels, only the boards placed anew [px]. Shape (V, P, 2 C)."""

    @classmethod
    def on(cls, model: SelfModel, views: BoardViews, held_out: bool) -> "KnownCameras":
        """Place the boards before the cameras as they were known.

        Args:
            held_out: Whether they were held out.

        Raises:
            ModelError: If it lacks a camera.
            DataError: If the images have another size.
            EstimationError: If a board cannot be placed.
        """
        cameras = cameras_for(model, views)
        known = SelfModel(model.name, cameras=dict(zip(views.cameras, cameras, strict=True)))
        return cls(known, held_out, held_out_residuals(cameras, views))

    def changes(self, learned: SelfModel, names: Iterable[str]) -> dict[str, Any]:
        """Return errors as they were and every number's change, as `result.json` has them.

        Numbers of lenses of two kinds are not compared.
        """
        before, now = self.model.cameras, learned.cameras
        others = {n for n, camera in now.items() if before[n].lens != camera.lens}
        compared = [n for n in names if ".k" not in n or n.partition(".")[0] not in others]
        errors = Errors(pixels=corner_distances(self.residuals), unit="px", poses=None)
        return {
            "model": self.model.name,
            "on": "test" if self.held_out else "train",
            **(errors.to_json() or {"n": 0}),
            "changes": parameter_changes(self.model, learned, compared),
        }


def other_scale(known: KnownCameras, calibration: CameraCalibration) -> str | None:
    """Say that squares have another size than stated, where cameras stand further apart than known.

    The side of a square scales what cameras learn of where they are, and nothing else.
    """
    cameras, p_GQ = calibration.views.cameras, calibration.views.p_GQ
    if len(cameras) < 2:
        return None
    before, now = (
        np.array([camera.X_WC[:3, 3] for camera in found])
        for found in (known.model.cameras.values(), calibration.cameras)
    )
    pairs = list(combinations(range(len(cameras)), 2))
    was = np.array([np.linalg.norm(before[j] - before[i]) for i, j in pairs])
    found = [
        baseline(now[j] - now[i], calibration.uncertainty, (cameras[i], cameras[j]))
        for i, j in pairs
    ]
    sigmas = [one.sigma for one in found]
    if not (was > 0.0).all() or None in sigmas:
        return None
    ratios = np.array([one.value for one in found], dtype=float) / was
    ratio = float(np.median(ratios))
    off = abs(ratio - 1.0)
    told = _TOLD * float(np.median(np.array(sigmas, dtype=float) / was))
    # All distances grow alike by a wrong square; by a camera that was moved some do.
    if off < max(_SCALE, told) or np.abs(ratios / ratio - 1.0).max() > 0.5 * off:
        return None
    apart = np.linalg.norm(p_GQ[1:] - p_GQ[0], axis=1).min()
    return (
        f"the cameras stand {ratio:.3f} times as far apart as {known.model.name!r} had them: are "
        f"the board's squares {1e3 * apart / ratio:.4g} mm in place of {1e3 * apart:.4g} mm, or "
        "were cameras moved?"
    )


def cameras_for(model: SelfModel, views: BoardViews) -> tuple[Camera, ...]:
    """Return the cameras that saw some boards, the first one at the world.

    Raises:
        ModelError: If it lacks a camera.
        DataError: If the images have another size.
    """
    missing = [camera for camera in views.cameras if camera not in model.cameras]
    if missing:
        there = f"has {listed(model.cameras)}" if model.cameras else "has none"
        raise ModelError(f"self-model {model.name!r} lacks the camera {missing[0]}: it {there}")
    found = [model.cameras[camera] for camera in views.cameras]
    for name, camera in zip(views.cameras, found, strict=True):
        width, height = views.size_of(name)
        if camera.image_size != (width, height):
            raise DataError(
                f"the {name} camera of {model.name!r} has {camera.image_size[0]} x "
                f"{camera.image_size[1]} pixels, the photographs have {width} x {height}"
            )
    X_FW = inverse(found[0].X_WC)
    return tuple(camera.at(X_FW @ camera.X_WC) for camera in found)
