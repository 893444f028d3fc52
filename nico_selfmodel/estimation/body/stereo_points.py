"""Kinematics through vision: an arm learned from what calibrated cameras saw (chapter 7).

What stereo reconstructs takes the place of motion capture, so that arm and cameras share one frame,
and the arm's predictions can be held against the pictures themselves (eq. 7.4).
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.dataset.dataset import Dataset
from nico_selfmodel.estimation.arm.kinematics import KinematicCalibration
from nico_selfmodel.estimation.body.body_initialization import in_left_camera, reconstructed
from nico_selfmodel.estimation.body.sights_apart import SightsApart
from nico_selfmodel.estimation.noise.arm_solution import Linearised
from nico_selfmodel.estimation.noise.hand_observations import covariance_of
from nico_selfmodel.estimation.noise.training_noise import LEAST, with_training_noise
from nico_selfmodel.estimation.observations.hand_rows import project_to_cameras
from nico_selfmodel.estimation.observations.matching import check_images
from nico_selfmodel.estimation.observations.observations import Observations
from nico_selfmodel.estimation.observations.pixel_evaluation import PixelEvaluation, evaluate_pixels
from nico_selfmodel.estimation.observations.sight_spread import SightSpread
from nico_selfmodel.estimation.results.calibration_result import (
    LAST,
    WARNING,
    CalibrationResult,
    Finding,
)
from nico_selfmodel.model.self_model import ParameterCovariance, SelfModel
from nico_selfmodel.optimization.losses import robust_scale
from nico_selfmodel.optimization.uncertainty import Uncertainty

_WILD = 4.0
"""Standard deviations at which two sights that miss each other by more count, as those that one
camera takes for another thing."""


@dataclass(frozen=True, eq=False)
class StereoPoints:
    """Data with pixels, and the cameras that saw them."""

    cameras: SelfModel
    """Both cameras, the left one at the world."""
    train: Dataset
    """Points that both cameras reconstructed, in the left camera's frame."""
    test: Dataset | None
    """The same, held out."""
    pixels: dict[str, Dataset]
    """What was seen, under `train` and, if held out, `test`; without sights that do not meet."""
    sights: dict[str, SightsApart]
    """Whether the sights of both cameras meet, in the same parts."""

    @classmethod
    def of(
        cls,
        cameras: SelfModel,
        train: Dataset,
        test: Dataset | None = None,
        pinned: frozenset[str] = frozenset(),
    ) -> "StereoPoints":
        """Reconstruct the hand.

        Args:
            cameras: A self-model with both cameras.
            train: Data with pixels.
            pinned: Parameters of the arm that are known.

        Raises:
            DataError: If too few poses were seen by both cameras, or most of their sights do not
                meet.
            ModelError: If the model has not both cameras.
        """
        seeing = in_left_camera(cameras)
        parts = {"train": train} | ({} if test is None else {"test": test})
        for data in parts.values():
            check_images(seeing, data)
        sights = {part: SightsApart.of(data, seeing.rig) for part, data in parts.items()}
        seen = {part: sights[part].without(data) for part, data in parts.items()}
        points = {"train": reconstructed(seen["train"], seeing, pinned)}
        if test is not None:
            points["test"] = reconstructed(seen["test"], seeing, None)
        return cls(seeing, points["train"], points.get("test"), seen, sights)

    @property
    def pixel_sigma(self) -> float | None:
        """Standard deviation of a pixel coordinate of the hand [px].

        A mark that is hard to locate scatters by more than the corners of boards, which the cameras
        were learned from. None where they do not say by how much those did.
        """
        boards, sights = self.cameras.pixel_sigma, self.sight_sigma
        return boards if boards is None or sights is None else max(boards, sights)

    @property
    def sight_sigma(self) -> float | None:
        """The same by how far two sights miss each other, which is one number a point [px]."""
        pixels = self.pixels["train"].pixels
        both = np.isfinite(pixels).all(axis=1)
        if not both.any():
            return None
        apart = np.linalg.norm(self.cameras.rig.triangulate(pixels[both]).residuals, axis=1)
        most = _WILD * robust_scale(apart, 1)
        return max(LEAST["pixels"], float(np.sqrt(np.mean(np.minimum(apart, most) ** 2))))

    @property
    def spread(self) -> SightSpread:
        """What both cameras are uncertain by where they see the hand."""
        points = self.train.p_WH_measured[self.train.measured]
        return SightSpread.of(self.cameras.rig, points)

    def complete(self, calibration: KinematicCalibration) -> KinematicCalibration:
        """Return an arm's calibration with the cameras in its self-model.

        What the cameras are uncertain by moved the points that the arm was learned from: it is in
            the arm's sigmas too, and arm and cameras are correlated.
        """
        model = replace(
            calibration.model,
            cameras=self.cameras.cameras,
            pixel_sigma=self.pixel_sigma or self.sight_sigma,
        )
        known, arm = self.cameras.covariance, calibration.uncertainty
        # A covariance may speak of an arm alone, whose cameras counted as exact.
        rig = self.cameras.rig
        cameras = tuple(n for n in rig.names if known is not None and n in known.names)
        if not cameras or arm is None:
            return replace(calibration, model=self._with_noise(model, calibration))
        together = _together(
            arm, self._gain(calibration, arm.names, cameras), self.cameras, cameras
        )
        split = len(arm.names)
        own = together[:split, :split]
        sigma = np.where(np.isfinite(arm.sigma), np.sqrt(np.diag(own)), np.inf)
        model = replace(model, covariance=ParameterCovariance((*arm.names, *cameras), together))
        return replace(
            calibration,
            model=self._with_noise(model, calibration),
            uncertainty=replace(arm, covariance=own, sigma=sigma),
        )

    def _gain(
        self, calibration: KinematicCalibration, arm: tuple[str, ...], cameras: tuple[str, ...]
    ) -> NDArray:
        """Return by how much parameters of the arm follow those of the cameras. Shape (k, e)."""
        parameters, noise = calibration.model.parameters, calibration.noise
        observations = Observations.from_dataset(self.train, calibration.model.markers)
        if calibration.spread is not None:
            expected = parameters.points(observations.angles, observations.marker)
            around = calibration.spread.covariances(expected, observations.p_WH)
            observations = observations.with_spread(around)
        assert noise is not None
        linear = Linearised.at(observations, parameters, ~calibration.outliers, noise)
        p = observations.predicted(parameters)[0]
        rig = self.cameras.rig
        _, by_point, by_cameras = project_to_cameras(p.T, rig.values, rig.lenses)
        # Pixels stay: the point moves so that it makes up for the cameras, as well as one point
        # can.
        by_point = by_point.transpose(2, 0, 1)
        columns = [rig.names.index(name) for name in cameras]
        moved = -np.linalg.pinv(by_point) @ by_cameras[columns].transpose(2, 1, 0)
        rows = linear.weights * linear.columns(frozenset(arm))
        size = np.maximum(np.linalg.norm(rows, axis=0), np.finfo(float).tiny)
        follows = np.linalg.lstsq(
            rows / size, linear.weights * linear.whitened(observations.alike(moved)), 1e-9
        )[0]
        return follows / size[:, None]

    def _with_noise(self, model: SelfModel, calibration: KinematicCalibration) -> SelfModel:
        """Return a completed model that says what noise its training left in the images."""
        rows = Observations.from_dataset(self.train, model.markers)
        seen = self.pixels["train"]
        own = seen.select(np.isin(seen.sample, rows.sample))
        aside, noise = rows.sample[calibration.outliers], calibration.noise
        joints = None if noise is None else noise.joint_sigma
        return with_training_noise(model, own, "pixels", aside, joints)

    def evaluate(self, model: SelfModel, part: str = "test") -> PixelEvaluation:
        """Hold a completed model against what the cameras saw."""
        return evaluate_pixels(model, self.pixels[part])

    def with_pixels(self, result: CalibrationResult, model: SelfModel) -> CalibrationResult:
        """Return an arm's result with errors in the images, and what the sights of both tell."""
        known = {"train": result.train, "test": result.test}
        for part in self.pixels:
            errors, pixels = known[part], self.evaluate(model, part).pixel_distances
            known[part] = errors if errors is None else replace(errors, pixels=pixels)
        told = self.sights["train"].findings()
        if "test" in self.sights:
            told += [_held_out(finding) for finding in self.sights["test"].findings()]
        return replace(result, findings=(*result.findings, *told), **known)


def _held_out(finding: Finding) -> Finding:
    severity = WARNING if finding.severity == WARNING else LAST
    return Finding(severity, f"held out: {finding.text}")


def _together(
    arm: Uncertainty, gain: NDArray, model: SelfModel, cameras: tuple[str, ...]
) -> NDArray:
    """Return the covariance of an arm and of the cameras it was learned through. (k + e, k + e)."""
    own = covariance_of(model, cameras)
    cross = gain @ own
    return np.block([[arm.covariance + cross @ gain.T, cross], [cross.T, own]])
