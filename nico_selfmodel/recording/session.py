"""Driving a body through a plan."""

from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Protocol, runtime_checkable

from numpy.typing import ArrayLike, NDArray

from nico_selfmodel.dataset.dataset import Dataset
from nico_selfmodel.dataset.joint_info import JointInfo
from nico_selfmodel.errors import RobotError
from nico_selfmodel.recording.recorded_samples import RecordedSamples
from nico_selfmodel.systems.measurements import Measurement

Progress = Callable[[int, int], None]
"""Called with the number of poses done and their total."""


class Body(Protocol):
    """What can be moved and watched: a simulated arm, later a station."""

    @property
    def joints(self) -> tuple[JointInfo, ...]:
        """Names, units and stops of the joints."""
        ...

    @property
    def markers(self) -> tuple[str, ...]:
        """Names of the tracked points."""
        ...

    def move_and_measure(self, command: ArrayLike) -> Measurement:
        """Move to encoder readings, settle, and look."""
        ...


@runtime_checkable
class Simulated(Protocol):
    """A body whose play and noise hang on where it was before."""

    def relive(self, command: ArrayLike) -> None:
        """Go through a visit again without keeping what is seen."""
        ...


def record(
    body: Body,
    plan: Iterable[tuple[str, NDArray]],
    name: str,
    *,
    source: str = "",
    seed: int | None = None,
    point_sigma_m: float | None = None,
    pixel_sigma_px: float | None = None,
    image_size: tuple[int, int] | None = None,
    until_seen: int = 5,
    enough: int | None = None,
    folder: str | Path | None = None,
    progress: Progress | None = None,
) -> Dataset:
    """Visit poses and return what was sensed.

    A pose whose markers are all lost is visited again, up to `until_seen` times, then left out.

    Where a simulated body's recording goes on, it first lives through the poses that are there
    again: what comes is then what would have come.

    Args:
        source: Where the data come from, for people.
        seed: Seed of a simulated body.
        point_sigma_m: Noise of the tracker, if known [m].
        pixel_sigma_px: Noise of tracked pixels, if known [px].
        image_size: Width and height of the pictures of a body with cameras [px].
        until_seen: Visits of a pose before it is given up.
        enough: Free poses that are enough; the plan then holds some to spare.
        folder: Where to keep the samples, and pictures that the body shows, from the first pose
            on. A recording that is already there is resumed if it is of the same plan.

    Returns:
        The data set; a marker that was lost has an empty position.

    Raises:
        DataError: If nothing was seen at all, the folder holds something else, or it cannot be
            written to (then what was recorded so far is in it, and in the error's `partial`).
        RobotError: If the body fails; what was recorded so far is in `partial`.
    """
    plan = list(plan)
    kept = RecordedSamples(
        body.joints,
        body.markers,
        {
            "name": name,
            "source": source,
            "seed": seed,
            "point_sigma_m": point_sigma_m,
            "pixel_sigma_px": pixel_sigma_px,
            "image_size": image_size,
        },
        None if folder is None else Path(folder),
    )
    kept.resume(plan)
    with kept:
        for index, (label, command) in enumerate(plan):
            if enough is not None and label == "" and kept.free_poses() >= enough:
                if progress is not None:
                    progress(len(plan), len(plan))
                break
            sample_pose(body, kept, index, label, command, until_seen)
            if progress is not None:
                progress(index + 1, len(plan))
    return kept.dataset()


def sample_pose(
    body: Body,
    kept: RecordedSamples,
    index: int,
    label: str,
    command: NDArray,
    until_seen: int,
    mirror: str = "",
) -> None:
    """Visit one pose of a plan until something is seen, and keep it.

    A simulated body lives again through the visits of a pose that is there already.

    Args:
        kept: Samples of the recording.
        index: Of the pose in the plan.
        command: Where to go [encoder units]. Shape (n,).
        until_seen: Visits before the pose is given up.
        mirror: Name of the mirror before the body.

    Raises:
        DataError: If the folder cannot be written.
        RobotError: If the body fails; what was recorded so far is in `partial`.
    """
    visits = kept.visits(index)
    if isinstance(body, Simulated):
        for _ in range(visits):
            body.relive(command)
        kept.relive(index)
    for _ in range(0 if visits else until_seen):
        try:
            measurement = body.move_and_measure(command)
        except RobotError as error:
            error.partial = kept.partial()
            raise
        if kept.add(index, label, measurement, mirror):
            return
