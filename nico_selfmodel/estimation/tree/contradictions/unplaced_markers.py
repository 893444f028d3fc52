"""Markers of which a recording does not tell where they are: never seen in it, or too seldom."""

from collections.abc import Collection, Mapping
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.dataset.body.body_dataset import BodyDataset
from nico_selfmodel.geometry.transform import transform
from nico_selfmodel.model.tree.body_tree import FREE, BodyTree
from nico_selfmodel.optimization.uncertainty import Uncertainty, UnobservableDirection

SELDOM = 5
"""Observations of a marker from which on something else than their number leaves it open."""


def unplaced_markers(
    data: BodyDataset, keep: NDArray, known: Uncertainty, told: Collection[str]
) -> dict[str, int]:
    """Return markers that were seen too seldom to be placed, and how often.

    Args:
        data: The recording.
        keep: Rows of its table that count. Boolean, shape (N,).
        known: What it tells.
        told: Parameters whose values come from elsewhere.
    """
    elsewhere = {name.rpartition(".")[0] for name in told}
    seen = _sights(data, keep)
    names = _never_seen(data, seen) - elsewhere
    names = names.union(*(seldom_seen(seen, way) for way in known.unobservable))
    return {name: seen[name] for name in sorted(names)}


def _sights(data: BodyDataset, keep: NDArray) -> dict[str, int]:
    """Return how often each marker was seen, or touched, in some rows."""
    table = data.observations.select(keep)
    other = table.other[table.other >= 0]
    counts = np.bincount(np.append(table.marker, other), minlength=len(data.markers))
    return dict(zip((m.name for m in data.markers), counts.tolist(), strict=True))


def _never_seen(data: BodyDataset, seen: Mapping[str, int]) -> set[str]:
    """Return markers that no row tells anything of, nor the recording itself."""
    boards = {joint.name for joint in data.joints if joint.motion == FREE}
    unseen = (m for m in data.markers if not seen[m.name] and m.xyz is None)
    return {m.name for m in unseen if m.on not in boards}


def seldom_seen(seen: Mapping[str, int], direction: UnobservableDirection) -> set[str]:
    """Return markers that were seen too seldom to tell where they are; none if more is open.

    Args:
        seen: How often each marker was seen.
        direction: What is left open.
    """
    frames = {name.rpartition(".")[0] for name in direction.names}
    return frames if all(seen.get(name, SELDOM) < SELDOM for name in frames) else set()


def hardly_seen(data: BodyDataset, keep: NDArray) -> set[str]:
    """Return markers that may be anywhere: seen too seldom. Rows that count, shape (N,)."""
    return {name for name, count in _sights(data, keep).items() if count < SELDOM}


def come_and_go(data: BodyDataset, returned: NDArray, outliers: NDArray) -> NDArray:
    """Return observations that stay out: set aside again after they had come back.

    Nothing contradicts a lone wrong sight of a marker that may be anywhere, and the next one does.
    Of markers that others show what is near the limit may come and go.

    Args:
        data: The recording.
        returned: Rows of its table that had come back. Boolean, shape (N,).
        outliers: Rows that are set aside. Boolean, shape (N,).

    Returns:
        Boolean, shape (N,).
    """
    anywhere = hardly_seen(data, ~outliers)
    own = np.array([marker.name in anywhere for marker in data.markers])
    return returned & outliers & own[data.observations.marker]


def in_the_middle(tree: BodyTree, names: Collection[str]) -> BodyTree:
    """Return a body with markers that may be anywhere in the middle of others of their link.

    A few wrong sights may have put them kilometres away.
    """
    markers = list(tree.markers)
    for k, marker in enumerate(markers):
        others = [m.X_LA[:3, 3] for m in tree.markers if m.on == marker.on and m.name not in names]
        if marker.name in names:
            middle = np.median(others, axis=0) if others else np.zeros(3)
            markers[k] = replace(marker, X_LA=transform(marker.X_LA[:3, :3], middle))
    return tree.with_markers(tuple(markers))


def without_markers(data: BodyDataset, names: Collection[str]) -> BodyDataset:
    """Return a recording without what was seen of some markers; all of it if that is all."""
    own = np.array([marker.name in names for marker in data.markers])
    table = data.observations
    keep = ~(own[table.marker] | (own[table.other] & (table.other >= 0)))
    return data.of_rows(keep) if keep.any() else data
