"""What may change in a body of any tree: encoders, markers, joints, cameras."""

from collections.abc import Iterator
from itertools import product

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.estimation.monitoring.diagnosis import Hypothesis, simple_hypothesis
from nico_selfmodel.estimation.monitoring.monitored_changes import (
    ANYTHING,
    JUMPS,
    RARER,
    SHIFTS,
    TURN,
    WEIGHTS,
    MonitoredChanges,
)
from nico_selfmodel.estimation.tree.tree_parameters import FRAME_PARTS
from nico_selfmodel.estimation.tree.tree_parameters import SHIFTS as PLACES
from nico_selfmodel.geometry.rotation import slope_together
from nico_selfmodel.model.tree.body_tree import REVOLUTE, WORLD, Attached, BodyTree

_WAYS = np.vstack([np.eye(3), -np.eye(3)])


def body_causes(tree: BodyTree, names: tuple[str, ...]) -> tuple[Hypothesis, ...]:
    """Return what may change: encoders' zeros and gears, markers, joints, cameras, their focus.

    A joint's frame turned about its own axis is another zero of its encoder. A gear changes about
    the zero at which it was mounted: both of its numbers move. What sits beyond a joint that was
    knocked askew moves with it, as does all that a link carries when it was hit.

    Args:
        names: Parameters that the observations depend on; causes with others are left out.
    """
    turning = [j for j, m in zip(tree.joints, tree.motions, strict=True) if m == REVOLUTE]
    carried = [marker.name for marker in tree.markers if marker.on != WORLD]
    found: list[tuple[str, tuple[str, ...]]] = [
        *((f"zero of {joint}", (f"{joint}.rz",)) for joint in turning),
        *((f"gear of {joint}", (f"{joint}.gear", f"{joint}.rz")) for joint in turning),
        *((f"marker {name}", _parts(name, PLACES)) for name in carried),
        *((f"{joint} on what carries it", _parts(joint, FRAME_PARTS)) for joint in turning),
        *(
            (
                f"{'camera' if s.name in tree.lenses else 'sensor'} {s.name} on its link",
                _parts(s.name, FRAME_PARTS),
            )
            for s in tree.sensors
        ),
    ]
    single = [
        simple_hypothesis(cause, own, names) for cause, own in found if set(own) <= set(names)
    ]
    return (*single, *_focal_lengths(tree, names), *_carried_together(tree, names))


def body_changes(tree: BodyTree, causes: tuple[Hypothesis, ...]) -> MonitoredChanges:
    """Return what is looked for at every pose, of the sizes that `monitored_changes` has.

    Args:
        causes: What may change.
    """
    kinds: dict[str, list[tuple[NDArray, float]]] = {"jump": [], "point": [], "camera": []}
    for cause in causes:
        if cause.cause.startswith("zero of "):
            for size, sign in product(JUMPS, (1.0, -1.0)):
                weight = 1.0 if size == JUMPS[0] else RARER
                kinds["jump"].append((sign * size * cause.basis[:, 0], weight))
        elif cause.names[0].endswith(".x"):
            for size, way in product(SHIFTS, _WAYS):
                weight = 1.0 if size == SHIFTS[0] else RARER
                # Of markers that move together shifts come first, then turns.
                kinds["point"].append((cause.basis[:, :3] @ (size * way), weight))
        elif cause.names[0].endswith(".rx"):
            kinds["camera"] += [(cause.basis[:, :3] @ (TURN * way), 1.0) for way in _WAYS]
    columns = [column for own in kinds.values() for column, _ in own]
    weights = [
        WEIGHTS[kind] * np.array([weight for _, weight in own]) / sum(w for _, w in own)
        for kind, own in kinds.items()
        if own
    ]
    weights.append(np.full(ANYTHING, WEIGHTS["anything"] / ANYTHING))
    whole = np.concatenate(weights)
    return MonitoredChanges(np.array(columns).T, whole / whole.sum())


def _parts(name: str, parts: tuple[str, ...]) -> tuple[str, ...]:
    return tuple(f"{name}.{part}" for part in parts)


def _focal_lengths(tree: BodyTree, names: tuple[str, ...]) -> Iterator[Hypothesis]:
    """Yield that a camera's focal lengths changed by one share: zoom or focus were turned."""
    for camera, lens in tree.lenses.items():
        values = {f"{camera}.{part}": lens.named_values[part] for part in ("fx", "fy")}
        if not values.keys() <= set(names):
            continue
        basis = np.zeros((len(names), 1))
        basis[[names.index(name) for name in values], 0] = list(values.values())
        yield Hypothesis(f"focal length of camera {camera}", tuple(values), basis)


def _carried_together(tree: BodyTree, names: tuple[str, ...]) -> Iterator[Hypothesis]:
    """Yield that all markers of a link move together."""
    for i, joint in enumerate(tree.joints):
        own: list[Attached] = [m for m in tree.markers if m.on == i]
        parts = tuple(part for m in own for part in _parts(m.name, PLACES))
        if len(own) < 2 or not set(parts) <= set(names):
            continue
        basis = np.zeros((len(names), 6))
        moved = slope_together([m.X_LA[:3, 3] for m in own])
        basis[[names.index(part) for part in parts]] = moved.reshape(-1, 6)
        yield Hypothesis(f"all markers on {joint} together", parts, basis)
