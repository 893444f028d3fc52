"""Frames of links that nothing describes, as told places of markers and sensors on them say.

A joint's motion tells its line, not where on it, and how turned about it, the frame of its link
begins: without a robot's description that is chosen. With X any motion that commutes with the
joint's own, X_PJ X^-1 of the joint and X X_LA of all that its link carries are the same body. So a
place that is told on such a link is no measurement at first: it says where the frame is, and a part
of the joint's frame is estimated in its stead. What is told beyond that is measured, and tells
lengths: of one marker on a joint that turns its distance from the axis, of two how they differ.
"""

from collections.abc import Collection, Iterator, Mapping
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.dataset.body.body_dataset import BodyDataset
from nico_selfmodel.estimation.tree.tree_parameters import FRAME_PARTS, SHIFTS
from nico_selfmodel.geometry.transform import inverse, transform
from nico_selfmodel.model.tree.body_tree import PRISMATIC, REVOLUTE, Attached, BodyTree

_ALONG = {REVOLUTE: ("z",), PRISMATIC: SHIFTS}
"""Parts of a joint's place that are chosen; it is turned about z as one likes, too."""


def told_on_links(
    data: BodyDataset, tree: BodyTree, known: Mapping[str, float]
) -> dict[str, float]:
    """Return what is told of markers and sensors on links whose frames nothing describes.

    Args:
        data: The recording, with markers of known place.
        known: Values that the user tells, by name.
    """
    told = dict(known)
    for marker in data.markers:
        if marker.xyz is not None:
            told |= {f"{marker.name}.{p}": v for p, v in zip(SHIFTS, marker.xyz, strict=True)}
    links = (i for i, motion in enumerate(tree.motions) if motion in _ALONG)
    carried = {item.name for i in links for item in _carried(tree, i)}
    return {name: value for name, value in told.items() if name.rpartition(".")[0] in carried}


def exchanged_parts(tree: BodyTree, told: Mapping[str, float]) -> frozenset[str]:
    """Return what is estimated of joint frames in the stead of what is told on their links.

    Args:
        told: Values of parts of markers and sensors, by name.
    """
    return frozenset(name for _, names, _ in _by_link(tree, told) for name in names)


def told_size(tree: BodyTree, told: Mapping[str, float]) -> str | None:
    """Return where lengths are told beyond where a link's frame is, in words; None if nowhere."""
    links = (tree.joints[i] for i, _, surplus in _by_link(tree, told) if surplus)
    return next((f"told places on {joint!r}" for joint in links), None)


def _by_link(tree: BodyTree, told: Mapping[str, float]) -> Iterator[tuple[int, list[str], bool]]:
    """Yield links on which something is told, what is chosen by it, and whether lengths are."""
    for i, motion in enumerate(tree.motions):
        own = [
            {part: told[name] for part in FRAME_PARTS if (name := f"{item.name}.{part}") in told}
            for item in _carried(tree, i)
        ]
        parts = [part for one in own for part in one]
        if motion not in _ALONG or not parts:
            continue
        around = _tells_turn(motion, own)
        chosen = [part for part in _ALONG[motion] if part in parts]
        used = len(chosen) + around - ("rz" in parts)
        shifts = sum(part in SHIFTS for part in parts)
        sized = any(value for one in own for part, value in one.items() if part in SHIFTS)
        names = [*chosen, *(["rz"] if around else [])]
        yield i, [f"{tree.joints[i]}.{part}" for part in names], sized and shifts > used


def _carried(tree: BodyTree, link: int) -> list[Attached]:
    return [item for item in (*tree.markers, *tree.sensors) if item.on == link]


def _tells_turn(motion: str, own: list[dict[str, float]]) -> bool:
    """Whether what is told says how a link's frame is turned about z."""
    if any("rz" in one for one in own):
        return True
    if motion == PRISMATIC:
        return any(sum(part in one for one in own) > 1 for part in ("x", "y"))
    # A marker on the axis is where it is however the frame turns.
    return any(
        bool(there) and not (len(there) == 2 and not any(there))
        for there in ([one[part] for part in ("x", "y") if part in one] for one in own)
    )


def framed(tree: BodyTree, told: Mapping[str, float], *, sized: bool) -> BodyTree:
    """Return the same body with link frames where what is told of places on them has these.

    Args:
        tree: A body as it was found.
        told: Values of parts of markers and sensors, by name.
        sized: Whether it is in metres; else it becomes as large as what is told says.
    """
    links = [i for i, _, _ in _by_link(tree, told)]
    if not sized and links:
        sizes = np.sum([_squares(tree, i, told) for i in links], axis=0)
        tree = tree.scaled(float(np.sqrt(sizes[1] / sizes[0])) if sizes.all() else 1.0)
    for i in links:
        p, there = _places(_carried(tree, i), told)
        turn = _turn(tree.motions[i], p, there)
        moved = there - p @ turn.T
        has = np.isfinite(there)
        along = np.array([part in _ALONG[tree.motions[i]] for part in SHIFTS]) & has.any(axis=0)
        shift = np.where(
            along, np.where(has, moved, 0.0).sum(axis=0) / np.maximum(has.sum(0), 1), 0
        )
        tree = _reframed(tree, i, transform(turn, shift))
    return _as_told(tree, told)


def _places(items: Collection[Attached], told: Mapping[str, float]) -> tuple[NDArray, NDArray]:
    """Return where markers and sensors are on their link, and are told to be, nan where not."""
    names = ([f"{item.name}.{part}" for part in SHIFTS] for item in items)
    there = np.array([[told.get(name, np.nan) for name in own] for own in names])
    return np.array([item.X_LA[:3, 3] for item in items]), there


def _squares(tree: BodyTree, link: int, told: Mapping[str, float]) -> NDArray:
    """Return squares of lengths that no choice of frame changes: as found, as told. Shape (2,)."""
    p, there = _places(_carried(tree, link), told)
    whole, along = np.isfinite(there[:, :2]).all(axis=1), np.isfinite(there[:, 2])
    out = []
    for q in (p, there):
        across, z = q[whole, :2], q[along, 2]
        if tree.motions[link] == PRISMATIC and len(across):
            across = across - across.mean(axis=0)
        out.append(float(np.sum(across**2) + np.sum((z - z.mean()) ** 2 if len(z) else 0.0)))
    return np.array(out)


def _turn(motion: str, p: NDArray, there: NDArray) -> NDArray:
    """Return the turn about z that brings places to where they are told to be. Shape (3, 3)."""
    whole = np.isfinite(there[:, :2]).all(axis=1)
    one, two = p[whole, :2], there[whole, :2]
    if motion == PRISMATIC and len(one):
        one, two = one - one.mean(axis=0), two - two.mean(axis=0)
    dot, cross = np.sum(one * two), np.sum(one[:, 0] * two[:, 1] - one[:, 1] * two[:, 0])
    angle = np.arctan2(cross, dot)
    half = np.argwhere(np.isfinite(there[:, :2]))
    if motion == REVOLUTE and not whole.any() and len(half):
        # One coordinate of a point that is at r (cos, sin) of an angle: the nearer of two ways.
        k, axis = half[0]
        r, now = float(np.hypot(*p[k, :2])), float(np.arctan2(p[k, 1], p[k, 0]))
        off = np.arccos(np.clip(there[k, axis] / max(r, 1e-12), -1.0, 1.0))
        ways = np.array([off, -off]) + (0.5 * np.pi if axis else 0.0) - now
        ways = (ways + np.pi) % (2.0 * np.pi) - np.pi
        angle = ways[np.argmin(np.abs(ways))]
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


def _reframed(tree: BodyTree, link: int, X: NDArray) -> BodyTree:
    """Return the same body with a link's frame moved by X^-1."""
    X_PJ = np.array(tree.X_PJ)
    X_PJ[tree.parent == link] = X @ X_PJ[tree.parent == link]
    X_PJ[link] = X_PJ[link] @ inverse(X)

    def of(items: tuple[Attached, ...]) -> tuple[Attached, ...]:
        return tuple(replace(o, X_LA=X @ o.X_LA) if o.on == link else o for o in items)

    return replace(
        tree, X_PJ=X_PJ, markers=of(tree.markers), sensors=of(tree.sensors), planes=of(tree.planes)
    )


def _as_told(tree: BodyTree, told: Mapping[str, float]) -> BodyTree:
    """Return a body with markers and sensors where they are told to be."""

    def of(items: tuple[Attached, ...]) -> tuple[Attached, ...]:
        p, there = _places(items, told) if items else (np.zeros((0, 3)), np.zeros((0, 3)))
        at = np.where(np.isfinite(there), there, p)
        return tuple(
            replace(item, X_LA=transform(item.X_LA[:3, :3], q))
            for item, q in zip(items, at, strict=True)
        )

    return replace(tree, markers=of(tree.markers), sensors=of(tree.sensors))
