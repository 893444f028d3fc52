"""How surely the body knows its hand over the workspace, and what would make it surer.

More data cures what the parameters are uncertain by; play of the joints and noise of the tracker
stay, however much is learned.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from nico_selfmodel.errors import ModelError
from nico_selfmodel.estimation.noise.hand_observations import JOINT_SIGMA, covariance_of
from nico_selfmodel.estimation.observations.hand_rows import project_to_cameras
from nico_selfmodel.model.arm.dh_parameters import slopes_by_angle
from nico_selfmodel.model.cameras.rig_parameters import SIDES
from nico_selfmodel.model.self_model import SelfModel


@dataclass(frozen=True, eq=False)
class WorkspaceAccuracy:
    """Uncertainty of the hand at poses; each figure is the rms length of the error vector."""

    p_LH: NDArray
    """Where the hand is expected [m]. Shape (N, 3)."""
    learned: NDArray
    """From what the parameters are uncertain by: more data cures it [m]. Shape (N,)."""
    mechanics: NDArray
    """From what the mechanics leave, play or noise about the model [m]. Shape (N,)."""
    learned_px: NDArray | None
    """Mean over both cameras of what more data cures, nan where one does not see the hand; None
    without cameras [px]. Shape (N,)."""
    mechanics_px: NDArray | None
    """Mean over both cameras of what the mechanics leave [px]. Shape (N,)."""

    @property
    def total(self) -> NDArray:
        """Both parts together [m]. Shape (N,)."""
        return np.hypot(self.learned, self.mechanics)

    @property
    def curable(self) -> float:
        """Share of the mean squared error in space that more data would cure."""
        return float(np.sum(self.learned**2) / max(np.sum(self.total**2), 1e-300))


def workspace_accuracy(model: SelfModel, readings: ArrayLike) -> WorkspaceAccuracy:
    """Split the uncertainty of the hand's first point into what data cure and mechanics leave.

    Args:
        model: The body with its covariance; with cameras its world is the left one's frame.
        readings: Encoder readings, in their own units. Shape (N, n).

    Returns:
        Figures at every pose.

    Raises:
        ModelError: If the model has no covariance or states no noise.
        ValueError: If the readings have not n columns.
    """
    if model.covariance is None or (model.noise_sigma is None and JOINT_SIGMA not in model.fit):
        raise ModelError(
            f"self-model {model.name!r} does not say how well it is known: learn it first"
        )
    prediction = model.predict(readings)
    assert prediction.covariance is not None
    learned = np.sqrt(np.trace(prediction.covariance, axis1=1, axis2=2))
    angles = model.servos.to_radians(np.atleast_2d(np.asarray(readings, float)))
    by_arm = model.parameters.predict(angles, np.zeros(len(angles), dtype=int))[1]
    slopes = slopes_by_angle(model.parameters, by_arm)
    play = float(model.fit.get(JOINT_SIGMA, 0.0))
    mechanics = np.full(len(learned), np.sqrt(3.0) * float(model.noise_sigma or 0.0))
    if play:
        mechanics = play * np.sqrt(np.sum(slopes**2, axis=(1, 2)))
    if set(model.cameras) != set(SIDES):
        return WorkspaceAccuracy(prediction.p_WH, learned, mechanics, None, None)
    parts = _in_images(model, prediction.p_WH, by_arm, slopes, play)
    unseen = np.isnan(model.rig.project(prediction.p_WH)).any(axis=1)
    learned_px, mechanics_px = (np.where(unseen, np.nan, part) for part in parts)
    return WorkspaceAccuracy(prediction.p_WH, learned, mechanics, learned_px, mechanics_px)


def _in_images(
    model: SelfModel, p_LH: NDArray, by_arm: NDArray, slopes: NDArray, play: float
) -> tuple[NDArray, NDArray]:
    """Return rms errors in the images from parameters and from mechanics [px]. Shape (N,) each."""
    _, by_point, by_cameras = project_to_cameras(p_LH.T, model.rig.values, model.rig.lenses)
    by_arm = np.einsum("ain,nik->nak", by_point, by_arm)
    whole = np.concatenate([by_arm, by_cameras.transpose(2, 1, 0)], axis=2)
    covariance = covariance_of(model, (*model.parameters.names, *model.rig.names))
    variance = np.einsum("nak,kl,nal->na", whole, covariance, whole)
    moved = np.einsum("ain,nij->naj", by_point, slopes)
    sensor = float(model.pixel_sigma or 0.0)
    left = play**2 * np.sum(moved**2, axis=2) + sensor**2
    # Two coordinates a camera, the mean of both cameras.
    return np.sqrt(variance.sum(axis=1) / 2.0), np.sqrt(left.sum(axis=1) / 2.0)
