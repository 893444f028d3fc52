"""Kinematics through vision: an arm learned from what calibrated eyes saw of its hand (chapter 7).

What stereo reconstructs takes the place of motion capture, so that arm and eyes share one frame,
and the arm's predictions can be held against the pictures themselves (eq. 7.4).
"""

from dataclasses import dataclass, replace
from typing import Any

from nico_selfmodel.dataset import Dataset
from nico_selfmodel.estimation.body_start import in_left_eye, reconstructed
from nico_selfmodel.estimation.error_statistics import ErrorStatistics
from nico_selfmodel.estimation.kinematics import KinematicCalibration
from nico_selfmodel.estimation.pixel_evaluation import PixelEvaluation, evaluate_pixels
from nico_selfmodel.model import SelfModel


@dataclass(frozen=True, eq=False)
class Sight:
    """Data with pixels, and the eyes that saw them."""

    eyes: SelfModel
    """Both eyes, the left one at the world."""
    train: Dataset
    """Points that both eyes reconstructed, in the left eye's frame."""
    test: Dataset | None
    """The same, held out."""
    pixels: dict[str, Dataset]
    """What was seen, under `train` and, if held out, `test`."""

    @classmethod
    def of(cls, eyes: SelfModel, train: Dataset, test: Dataset | None = None) -> "Sight":
        """Reconstruct the hand.

        Args:
            eyes: A self-model with both eyes.
            train: Data with pixels.
            test: Held-out data.

        Raises:
            DataError: If too few poses were seen by both eyes.
            ModelError: If the model has not both eyes.
        """
        seeing = in_left_eye(eyes)
        seen = {"train": train} | ({} if test is None else {"test": test})
        points = {name: reconstructed(data, seeing) for name, data in seen.items()}
        return cls(seeing, points["train"], points.get("test"), seen)

    def complete(self, calibration: KinematicCalibration) -> KinematicCalibration:
        """Return an arm's calibration with the eyes in its self-model."""
        model = replace(
            calibration.model, cameras=self.eyes.cameras, pixel_sigma=self.eyes.pixel_sigma
        )
        return replace(calibration, model=model)

    def evaluate(self, model: SelfModel, part: str = "test") -> PixelEvaluation:
        """Hold a completed model against what the eyes saw."""
        return evaluate_pixels(model, self.pixels[part])

    def add_pixels(self, document: dict[str, Any], model: SelfModel) -> None:
        """Add the errors in the images to the content of `result.json`."""
        for part in self.pixels:
            statistics = self.evaluate(model, part).pixel_statistics
            if document.get(part) is not None and statistics is not None:
                document[part]["pixels"] = as_pixels(statistics)


def as_pixels(statistics: ErrorStatistics) -> dict[str, float]:
    """Return statistics of distances in images as `result.json` has them [px]."""
    names = ("mean", "sd", "rms", "median", "p95", "max")
    return {name: float(getattr(statistics, name)) for name in names}
