"""The samples of a recording under way, in memory and, if asked for, on disk."""

import re
import time
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.dataset.approach import Sides
from nico_selfmodel.dataset.dataset import Dataset
from nico_selfmodel.dataset.folder import load_dataset, save_dataset
from nico_selfmodel.dataset.joint_info import JointInfo
from nico_selfmodel.errors import DataError
from nico_selfmodel.files.whole import recover
from nico_selfmodel.model.cameras.rig_parameters import SIDES
from nico_selfmodel.names import shown
from nico_selfmodel.systems.measurements import CameraMeasurement, Measurement
from nico_selfmodel.vision.images.image_file import write_image


@dataclass(frozen=True, eq=False)
class RecordedPose:
    """One pose of the plan, as sensed."""

    index: int
    label: str
    encoders: NDArray
    approach: NDArray
    """How each reading changed when the joint last moved, -1 or 1; 0 where it is not known."""
    points: NDArray
    """Shape (m, 3), nan where lost."""
    pixels: NDArray
    """Shape (m, 4), nan where not seen."""
    mirror: str = ""
    """Name of the mirror before the body, empty where there was none."""
    reflected: NDArray | None = None
    """Pixels in that mirror. Shape (m, 4), nan where not seen."""
    visits: int = 1
    """How often the pose was visited until something was seen."""

    @property
    def views(self) -> dict[str, NDArray]:
        """Mirror, empty for the direct view, -> pixels."""
        shown = {"": self.pixels}
        return shown if self.reflected is None else {**shown, self.mirror: self.reflected}

    @cached_property
    def complete(self) -> bool:
        """Whether every marker was located, by both cameras where there are cameras."""
        by_pixels = np.isfinite(self.pixels).all(axis=1)
        return bool((np.isfinite(self.points).all(axis=1) | by_pixels).all())


POSE, VISITS = "pose", "visits"
"""Extra columns of a recording in a folder: which pose of the plan a sample is, from 1, and how
often it was visited until something was seen."""
IMAGES = "images"
_STRAY = 0.02
"""Share of a joint's range within which a reading may belong to a command."""
_WRITING = 0.1
"""Largest part of the time that is spent on writing. A folder is written as a whole: of poses that
come faster than that, several are written together."""


class RecordedSamples:
    """What a recording has so far.

    Leaving its `with` block, for whatever reason, writes what is not in the folder yet.
    """

    def __init__(
        self,
        joints: Sequence[JointInfo],
        markers: Sequence[str],
        about: Mapping[str, Any],
        folder: Path | None = None,
    ) -> None:
        """Start with nothing.

        Args:
            about: What else the data set states, by the names of `Dataset`.
            folder: Where to keep the samples.
        """
        self._joints, self._markers = tuple(joints), tuple(markers)
        self._about, self._folder = dict(about), folder
        self._samples: dict[int, RecordedPose] = {}
        self._visits: Counter[int] = Counter()
        self._sides = Sides.of(self._joints)
        self._images = False
        self._saved = 0
        """Samples that are in the folder."""
        self._due = -np.inf
        """When the folder is to be written next, by the monotonic clock [s]."""

    def __enter__(self) -> Self:
        """Begin to record."""
        return self

    def __exit__(self, *raised: object) -> None:
        """Write what is not in the folder yet.

        Raises:
            DataError: If the folder cannot be written.
        """
        if self._folder is not None and np.isfinite(self._due) and self._saved < len(self._samples):
            self._save(max(self._samples))

    def free_poses(self, before: int | None = None) -> int:
        """Return in how many free poses, of those before one of the plan, all markers were located.

        Args:
            before: Index of that pose; all poses count if omitted.
        """
        return sum(s.label == "" and s.complete for s in self._until(before))

    def _until(self, before: int | None) -> list[RecordedPose]:
        return [s for s in self._samples.values() if before is None or s.index < before]

    def visits(self, index: int) -> int:
        """Return how often a pose of the plan was visited until it was recorded, 0 if it is not."""
        return self._samples[index].visits if index in self._samples else 0

    def relive(self, index: int) -> None:
        """Take notice that the body came to a pose that is there already, as it did before."""
        if index in self._samples:
            self._sides = self._sides.after(self._samples[index].encoders)

    def resume(self, plan: Sequence[tuple[str, NDArray]]) -> None:
        """Take over what an earlier recording of the same plan left in the folder.

        Raises:
            DataError: If the folder holds something else, or a recording of another plan.
        """
        if self._folder is None:
            return
        recover(self._folder)
        if not self._folder.exists():
            return
        data = load_dataset(self._folder)
        if POSE not in data.extra:
            raise DataError(
                f"{self._folder}: a data set that was not recorded pose by pose cannot be resumed"
            )
        if data.joints != self._joints or set(data.marker.tolist()) - set(self._markers):
            raise DataError(f"{self._folder}: was recorded with another body; choose another name")
        index = self._counts(data, POSE) - 1
        visits = self._counts(data, VISITS) if VISITS in data.extra else np.ones(len(data), int)
        self._images = data.cameras is not None
        for i in np.unique(index):
            rows = data.select(index == i)
            self._check_plan(plan, int(i), str(rows.sweep[0]), rows.encoders[0])
            if not self._images or all(path.exists() for path in self._image_paths(int(i))):
                self._samples[int(i)] = self._sample(int(i), rows, int(visits[index == i][0]))
        self._saved = len(self._samples)

    def _counts(self, data: Dataset, column: str) -> NDArray:
        """Return an extra column of the folder, whole numbers from 1."""
        for sample, cell in zip(data.sample, data.extra[column], strict=True):
            if not re.fullmatch("[1-9][0-9]{0,8}", cell):
                raise DataError(
                    f"{self._folder}: sample {sample} has {column} {shown(cell)}, a whole number "
                    "from 1 was expected; choose another name"
                )
        return np.array(data.extra[column], dtype=int)

    def _sample(self, index: int, rows: Dataset, visits: int) -> RecordedPose:
        """Return the sample that rows of a folder describe.

        Raises:
            DataError: If they are not the rows that one pose leaves.
        """
        mirror = max(rows.mirror.tolist())
        views = [rows.select(rows.mirror == name) for name in ("", mirror)]
        if any(sorted(view.marker.tolist()) != sorted(self._markers) for view in views):
            raise DataError(
                f"{self._folder}: pose {index + 1} does not have one row for each of "
                f"{', '.join(self._markers)}; choose another name"
            )
        order = [[v.marker.tolist().index(marker) for marker in self._markers] for v in views]
        direct, reflected = views
        return RecordedPose(
            index,
            str(rows.sweep[0]),
            rows.encoders[0],
            rows.approach[0],
            direct.p_WH_measured[order[0]],
            direct.pixels[order[0]],
            mirror,
            reflected.pixels[order[1]] if mirror else None,
            visits,
        )

    def _check_plan(
        self, plan: Sequence[tuple[str, NDArray]], index: int, label: str, encoders: NDArray
    ) -> None:
        """Refuse a sample that is not of the plan."""
        span = [
            np.inf if j.lower is None or j.upper is None else j.upper - j.lower
            for j in self._joints
        ]
        low = [-np.inf if j.lower is None else j.lower for j in self._joints]
        high = [np.inf if j.upper is None else j.upper for j in self._joints]
        if index < len(plan) and plan[index][0] == label:
            away = np.abs(encoders - np.clip(plan[index][1], low, high))
            if (away <= _STRAY * np.array(span)).all():
                return
        raise DataError(
            f"{self._folder}: holds a recording of other poses (pose {index + 1} differs); choose "
            "another name, or the same seed and numbers as before"
        )

    def complete_in(self, mirror: str, before: int | None = None) -> int:
        """Return in how many poses, of those before one of the plan, both cameras saw every marker.

        Args:
            before: Index of that pose; all poses count if omitted.
        """
        views = [s.views[mirror] for s in self._until(before) if s.mirror == mirror]
        return sum(bool(np.isfinite(pixels).all()) for pixels in views)

    def add(self, index: int, label: str, measurement: Measurement, mirror: str = "") -> bool:
        """Keep what was sensed at a pose, unless nothing was seen.

        Args:
            index: Of the pose in the plan.
            mirror: Name of the mirror before the body; its reflections are kept too.

        Returns:
            Whether it was kept.

        Raises:
            DataError: If the folder cannot be written; earlier samples stay as they are.
        """
        self._visits[index] += 1
        self._sides = self._sides.after(measurement.encoders)
        approach = self._sides.side
        m = len(self._markers)
        points, pixels = np.full((m, 3), np.nan), np.full((m, 4), np.nan)
        for k, marker in enumerate(self._markers):
            p = measurement.points[marker]
            if p is not None:
                points[k] = p
            if isinstance(measurement, CameraMeasurement):
                pixels[k] = measurement.pixels[marker]
        reflected = None
        if mirror and isinstance(measurement, CameraMeasurement):
            reflected = np.array([measurement.reflected[marker] for marker in self._markers])
        seen = [points, pixels] + ([] if reflected is None else [reflected])
        if all(np.isnan(values).all() for values in seen):
            return False
        self._samples[index] = RecordedPose(
            *(index, label, measurement.encoders, approach, points, pixels, mirror, reflected),
            visits=self._visits[index],
        )
        if self._folder is not None:
            images = measurement.images if isinstance(measurement, CameraMeasurement) else None
            self._images |= images is not None
            if images is not None or time.monotonic() >= self._due:
                self._save(index, images)
        return True

    def _save(self, index: int, images: tuple[NDArray, NDArray] | None = None) -> None:
        """Write the folder, and the pictures of its last sample.

        Raises:
            DataError: If it cannot be written; what was written before stays as it is.
        """
        begun = time.monotonic()
        try:
            self._write(index, images)
        except (OSError, DataError) as error:
            del self._samples[index]
            self._due = np.inf
            reason = error.strerror if isinstance(error, OSError) else str(error)
            raise DataError(
                f"{self._folder}: pose {index + 1} could not be written: {reason}; the "
                f"{self._saved} poses before it are kept, start again to go on",
                partial=self.partial(),
            ) from error
        self._saved = len(self._samples)
        now = time.monotonic()
        self._due = now + (now - begun) * (1.0 / _WRITING - 1.0)

    def _write(self, index: int, images: tuple[NDArray, NDArray] | None) -> None:
        assert self._folder is not None
        if images is not None and self._folder.exists():
            self._write_images(index, images)
        save_dataset(self.dataset(), self._folder, force=True)
        if images is not None and not (self._folder / IMAGES).exists():
            self._write_images(index, images)

    def _write_images(self, index: int, images: tuple[NDArray, NDArray]) -> None:
        assert self._folder is not None
        (self._folder / IMAGES).mkdir(exist_ok=True)
        for path, image in zip(self._image_paths(index), images, strict=True):
            write_image(path, image)

    def _image_paths(self, index: int) -> list[Path]:
        assert self._folder is not None
        return [self._folder / IMAGES / f"{camera}{index + 1:04d}.png" for camera in SIDES]

    def partial(self) -> Dataset | None:
        """Return what there is, None if nothing."""
        return self.dataset() if self._samples else None

    def dataset(self) -> Dataset:
        """Lay the samples out as rows, one for each pose and marker, in the order of the plan.

        Raises:
            DataError: If nothing was seen at all.
        """
        samples = [self._samples[index] for index in sorted(self._samples)]
        m, n = len(self._markers), len(self._joints)
        # One row for each sample, view and marker.
        views = [
            (k, sample, mirror, pixels)
            for k, sample in enumerate(samples, start=1)
            for mirror, pixels in sample.views.items()
        ]
        nowhere = np.full((m, 3), np.nan)
        about = dict(self._about)
        if self._images:
            about["cameras"] = {"images": f"{IMAGES}/<camera><pose>.png"}
        if self._folder is not None:
            columns = {
                POSE: [str(sample.index + 1) for _, sample, _, _ in views],
                VISITS: [str(sample.visits) for _, sample, _, _ in views],
            }
            about["extra"] = {
                name: tuple(cell for cell in cells for _ in range(m))
                for name, cells in columns.items()
            }
        if not any(np.isfinite(pixels).any() for *_, pixels in views):
            about["image_size"] = None
        return Dataset(
            joints=self._joints,
            sample=np.repeat(np.array([k for k, *_ in views], dtype=int), m),
            encoders=np.repeat(np.reshape([s.encoders for _, s, *_ in views], (-1, n)), m, axis=0),
            approach=np.repeat(np.reshape([s.approach for _, s, *_ in views], (-1, n)), m, axis=0),
            p_WH_measured=np.reshape(
                [nowhere if mirror else s.points for _, s, mirror, _ in views], (-1, 3)
            ),
            pixels=np.reshape([pixels for *_, pixels in views], (-1, 4)),
            sweep=np.repeat(np.array([s.label for _, s, *_ in views], dtype=str), m),
            marker=np.tile(np.array(self._markers), len(views)),
            mirror=np.repeat(np.array([mirror for _, _, mirror, _ in views], dtype=str), m),
            **about,
        )
