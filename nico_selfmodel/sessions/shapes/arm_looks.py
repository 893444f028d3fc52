"""Pictures of an arm without a mirror: where its links were, and what else is in the picture."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.dataset.dataset import Dataset
from nico_selfmodel.errors import DataError
from nico_selfmodel.estimation.noise.joints_by_hand import JointsByHand, joints_by_hand
from nico_selfmodel.estimation.observations.matching import reading_columns
from nico_selfmodel.geometry.rotation import rotation_vectors_of
from nico_selfmodel.model.self_model import SelfModel
from nico_selfmodel.recording.recorded_samples import IMAGES, POSE
from nico_selfmodel.sessions.looks.expecting import POINT_SIGMA
from nico_selfmodel.sessions.looks.known_body import Shot
from nico_selfmodel.sessions.mirrors.own_pictures import picture_noises, pictures_of
from nico_selfmodel.systems.rendering.body_image import BodyImage
from nico_selfmodel.vision.surprise.surprise import about_the_loose

FEWEST_LOOKS = 15
"""That a shape takes: a place must be shown by ten pictures, and half of those of an arm show
another side of it."""
_STEP = 1e-4
"""Of the differences by which it is told how joints move links [rad]."""


@dataclass(frozen=True, eq=False)
class ArmLook:
    """One pose, with what joints were off by as the hand told it."""

    pictures: tuple[NDArray, NDArray]
    """Left and right, BGR. Shape (h, w, 3) each."""
    poses: Mapping[str, NDArray]
    """Link -> its pose in W. Shape (4, 4) each."""
    covariance: NDArray
    """Of all joints [rad^2]. Shape (n, n)."""
    by_joint: Mapping[str, NDArray]
    """Link -> how it turns, as a rotation vector, and shifts with the joints. Shape (6, n) each."""
    labels: tuple[NDArray, NDArray]
    """Number of the link that each pixel is expected to show. Shape (h, w) each."""
    loose: tuple[NDArray, NDArray]
    """By what links are not known where each pixel is expected to show them [px]. (h, w) each."""

    def covered(self, image: BodyImage, own: frozenset[str], side: int) -> NDArray:
        """Return where a picture may show other links of the arm. Shape (h, w)."""
        other = [number for number in image.moving if image.links[number] not in own]
        shown = np.isin(self.labels[side], other)
        return about_the_loose(np.where(shown, self.loose[side], np.nan))


@dataclass(frozen=True, eq=False)
class ArmLooks:
    """Poses of a recording in which the hand was where it was expected."""

    model: SelfModel
    """Arm and cameras."""
    data: Dataset
    """Rows without a mirror."""
    folder: Path
    """In which the recording lies, with its pictures."""
    errors: JointsByHand
    """Of these poses alone."""

    @classmethod
    def of(cls, model: SelfModel, data: Dataset, folder: str | Path) -> "ArmLooks":
        """Take what a recording shows without a mirror.

        Raises:
            DataError: If no pictures were kept, or the recording is of other joints or cameras.
        """
        if POSE not in data.extra or not (Path(folder) / IMAGES).is_dir():
            raise DataError(f"{folder}: no pictures were kept; record them with `record --images`")
        seen = np.isfinite(data.pixels).any(axis=1) & (data.mirror == "")
        seen &= np.isin(data.marker, model.markers)
        if not seen.any():
            raise DataError(
                f"{folder}: the hand is seen in no pose without a mirror, and a moving link is "
                "learned in such: record some, with `record --images`"
            )
        direct = data.select(seen)
        return cls(model, direct, Path(folder), joints_by_hand(model, direct))

    @property
    def kept(self) -> NDArray:
        """Numbers of the poses that count. Shape (K,)."""
        return np.flatnonzero(self.errors.expected)

    @property
    def noise(self) -> tuple[float, float]:
        """Standard deviation of a grey level of either camera, by what two poses both show."""
        shots = [Shot("", np.zeros(0), self._pictures(int(k))) for k in self.kept[:2]]
        return picture_noises(shots)

    def _row(self, k: int) -> int:
        return int(np.flatnonzero(self.data.sample == self.errors.sample[k])[0])

    def _pictures(self, k: int) -> tuple[NDArray, NDArray]:
        return pictures_of(self.model, self.folder, int(self.data.extra[POSE][self._row(k)]))

    def looks(self, image: BodyImage) -> Iterator[ArmLook]:
        """Return these poses one after the other: all pictures at once take hundreds of MB.

        Args:
            image: What is expected to be seen; it is not closed here.
        """
        columns = reading_columns(self.model, self.data)
        for k in self.kept.tolist():
            readings = self.data.encoders[self._row(k)][columns]
            q = self.model.servos.to_joint(readings) + self.errors.off[k]
            yield self._look(image, k, q, self._pictures(k))

    def _look(
        self, image: BodyImage, k: int, q: NDArray, pictures: tuple[NDArray, NDArray]
    ) -> ArmLook:
        readings = self.model.servos.to_encoder(q)
        seen = [image.expect(readings, None, side) for side in range(len(pictures))]
        cameras = self.model.rig.cameras
        left, right = (
            camera.fx * POINT_SIGMA / one.depth for camera, one in zip(cameras, seen, strict=True)
        )
        by_joint = self._by_joint(image, q)
        return ArmLook(
            pictures,
            image.poses(readings),
            self.errors.covariance[k],
            by_joint,
            (seen[0].labels, seen[1].labels),
            (left, right),
        )

    def _by_joint(self, image: BodyImage, q: NDArray) -> dict[str, NDArray]:
        """Return how links move with the joints, by differences."""
        columns: dict[str, list[NDArray]] = {}
        for step in _STEP * np.eye(len(q)):
            after, before = (
                image.poses(self.model.servos.to_encoder(one)) for one in (q + step, q - step)
            )
            for link, X in after.items():
                turned = X[:3, :3] @ before[link][:3, :3].T
                turn = rotation_vectors_of(turned[None])[0]
                moved = np.concatenate([turn, X[:3, 3] - before[link][:3, 3]])
                columns.setdefault(link, []).append(moved / (2.0 * _STEP))
        return {link: np.stack(own, axis=1) for link, own in columns.items()}
