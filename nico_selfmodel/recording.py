"""Drive a body through poses and return what it sensed as a data set."""

from collections.abc import Callable, Iterable, Sequence
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from nico_selfmodel.dataset import Dataset, JointInfo
from nico_selfmodel.systems import Sighting

HOME = "home"
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

    def visit(self, command: ArrayLike) -> Sighting:
        """Move to encoder readings, settle, and look."""
        ...


def sweep_commands(
    joints: Sequence[JointInfo],
    home: ArrayLike,
    arcs: ArrayLike,
    counts: Sequence[int],
    *,
    home_repeats: int = 1,
) -> list[tuple[str, NDArray]]:
    """Plan a circle of every joint about a shared home pose (thesis algorithm 1).

    Args:
        joints: Joints with stops.
        home: Home pose [encoder units]. Shape (n,).
        arcs: Arc of each joint, spread evenly about home and kept between the stops
            [encoder units]. Shape (n,).
        counts: Poses of each joint beside home. Length n.
        home_repeats: How often home itself is visited.

    Returns:
        Sweep labels and commands.
    """
    home = np.asarray(home, dtype=float)
    plan = [(HOME, home)] * home_repeats
    for i, (joint, arc, count) in enumerate(
        zip(joints, np.asarray(arcs, dtype=float), counts, strict=True)
    ):
        low, high = home[i] - 0.5 * arc, home[i] + 0.5 * arc
        low = low if joint.lower is None else max(low, joint.lower)
        high = high if joint.upper is None else min(high, joint.upper)
        # An odd count would visit home again in its middle.
        values = np.linspace(low, high, count + count % 2)
        for value in values[np.sort(np.argsort(-np.abs(values - home[i]), kind="stable")[:count])]:
            command = home.copy()
            command[i] = value
            plan.append((joint.name, command))
    return plan


def random_commands(
    joints: Sequence[JointInfo],
    home: ArrayLike,
    ranges: ArrayLike,
    count: int,
    rng: np.random.Generator,
) -> list[tuple[str, NDArray]]:
    """Plan random poses within a range about home, kept between the stops.

    Args:
        joints: Joints with stops.
        home: Home pose [encoder units]. Shape (n,).
        ranges: Full range of each joint about home [encoder units]. Shape (n,).
        count: Number of poses.
        rng: Source of the poses.

    Returns:
        Empty sweep labels and commands.
    """
    home, half = np.asarray(home, dtype=float), 0.5 * np.asarray(ranges, dtype=float)
    low = [-np.inf if joint.lower is None else joint.lower for joint in joints]
    high = [np.inf if joint.upper is None else joint.upper for joint in joints]
    low, high = np.maximum(home - half, low), np.minimum(home + half, high)
    return [("", command) for command in rng.uniform(low, high, (count, len(home)))]


def record(
    body: Body,
    plan: Iterable[tuple[str, NDArray]],
    name: str,
    *,
    source: str = "",
    seed: int | None = None,
    point_sigma_m: float | None = None,
    until_seen: int = 5,
    progress: Progress | None = None,
) -> Dataset:
    """Visit poses and return what was sensed.

    A pose whose markers are all lost is visited again, up to `until_seen` times, then left out.

    Args:
        body: What moves and sees.
        plan: Sweep labels and commands.
        name: Name of the data set.
        source: Where the data come from, for people.
        seed: Seed of a simulated body.
        point_sigma_m: Noise of the tracker, if known [m].
        until_seen: Visits of a pose before it is given up.
        progress: Called after each pose.

    Returns:
        The data set; a marker that was lost has an empty position.

    Raises:
        DataError: If nothing was seen at all.
    """
    plan = list(plan)
    labels: list[str] = []
    seen: list[Sighting] = []
    for done, (label, command) in enumerate(plan, start=1):
        for _ in range(until_seen):
            sighting = body.visit(command)
            if any(p is not None for p in sighting.points.values()):
                labels.append(label)
                seen.append(sighting)
                break
        if progress is not None:
            progress(done, len(plan))
    return _dataset(body, labels, seen, name, source, seed, point_sigma_m)


def _dataset(
    body: Body,
    labels: list[str],
    seen: list[Sighting],
    name: str,
    source: str,
    seed: int | None,
    point_sigma_m: float | None,
) -> Dataset:
    """Lay sightings out as rows, one for each pose and marker."""
    markers = body.markers
    m, n = len(markers), len(body.joints)
    nowhere = np.full(3, np.nan)
    points = [
        nowhere if s.points[k] is None else np.asarray(s.points[k]) for s in seen for k in markers
    ]
    return Dataset(
        name=name,
        joints=body.joints,
        sample=np.repeat(np.arange(1, len(seen) + 1), m),
        encoders=np.repeat(np.reshape([s.encoders for s in seen], (-1, n)), m, axis=0),
        p_WH_measured=np.reshape(points, (-1, 3)),
        sweep=np.repeat(np.array(labels, dtype=str), m),
        marker=np.tile(np.array(markers), len(seen)),
        point_sigma_m=point_sigma_m,
        source=source,
        seed=seed,
    )
