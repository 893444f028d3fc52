"""Markers of which a recording does not tell where they are: never seen in it, or too seldom."""

from collections.abc import Collection

import numpy as np

from nico_selfmodel.dataset.body.body_dataset import BodyDataset
from nico_selfmodel.model.tree.body_tree import FREE
from nico_selfmodel.optimization.uncertainty import Uncertainty, UnobservableDirection

_SELDOM = 5
"""Observations of a marker from which on something else than their number leaves it open."""


def sights(data: BodyDataset) -> dict[str, int]:
    """Return how often each marker was seen, or touched."""
    table = data.observations
    other = table.other[table.other >= 0]
    counts = np.bincount(np.append(table.marker, other), minlength=len(data.markers))
    return dict(zip((m.name for m in data.markers), counts.tolist(), strict=True))


def never_seen(data: BodyDataset) -> tuple[str, ...]:
    """Return markers that no row tells anything of, nor the recording itself."""
    boards = {joint.name for joint in data.joints if joint.motion == FREE}
    seen = sights(data)
    return tuple(
        m.name for m in data.markers if not seen[m.name] and m.xyz is None and m.on not in boards
    )


def seldom_seen(data: BodyDataset, direction: UnobservableDirection) -> tuple[str, ...]:
    """Return markers that were seen too seldom to tell where they are; none if more is open.

    Args:
        data: The recording.
        direction: What it leaves open.
    """
    seen = sights(data)
    frames = sorted({name.rpartition(".")[0] for name in direction.names})
    few = all(seen.get(name, _SELDOM) < _SELDOM for name in frames)
    return tuple(frames) if few else ()


def unplaced_markers(
    data: BodyDataset, known: Uncertainty, told: Collection[str]
) -> dict[str, int]:
    """Return markers that were seen too seldom to be placed, and how often.

    Args:
        data: The recording.
        known: What it tells.
        told: Parameters whose values come from elsewhere.
    """
    elsewhere = {name.rpartition(".")[0] for name in told}
    names = {name for name in never_seen(data) if name not in elsewhere}
    names = names.union(*(seldom_seen(data, way) for way in known.unobservable))
    seen = sights(data)
    return {name: seen[name] for name in sorted(names)}


def without_markers(data: BodyDataset, names: Collection[str]) -> BodyDataset:
    """Return a recording without what was seen of some markers; all of it if that is all."""
    own = np.array([marker.name in names for marker in data.markers])
    table = data.observations
    keep = ~(own[table.marker] | (own[table.other] & (table.other >= 0)))
    return data.of_rows(keep) if keep.any() else data
