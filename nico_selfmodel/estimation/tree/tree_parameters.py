"""A body as one vector of named parameters.

A joint's frame is X_PJ = X0 (exp(w), v): turned by `rx, ry, rz` and shifted by `x, y, z` in the
frame that it is told from; so is a plane's, of which rx, ry and z are all there is. A marker's,
sensor's or flange's is (exp(w), t): its rotation vector and its place on its link. Gears,
intrinsics and distances of contacts are what they are. exp(w + dw) = exp([J dw]) exp(w), J
the left Jacobian, makes every derivative exact wherever the solver stands.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.geometry.rotation import (
    rotation_from_vector,
    rotation_vector_slope,
    rotation_vectors_of,
)
from nico_selfmodel.geometry.transform import inverse, transform
from nico_selfmodel.model.arm.bending import Bending
from nico_selfmodel.model.cameras.camera import Camera
from nico_selfmodel.model.cameras.mirror import MIRROR_PARTS, MIRROR_UNITS
from nico_selfmodel.model.cameras.projection import intrinsic_units, intrinsics_of
from nico_selfmodel.model.tree.body_tree import (
    FLANGE,
    FREE,
    PRISMATIC,
    REVOLUTE,
    WHOLE_POSES,
    Attached,
    BodyTree,
)
from nico_selfmodel.names import refuse_unknown

TURNS, SHIFTS = ("rx", "ry", "rz"), ("x", "y", "z")
FRAME_PARTS = (*TURNS, *SHIFTS)
PLANE_PARTS = ("rx", "ry", "z")
"""Parts of a plane's frame that move the plane."""
APART = "distance"
"""Part of a contact: how far its markers are apart."""
_LINE = {REVOLUTE: ("rx", "ry", "x", "y"), PRISMATIC: ("rx", "ry"), FLANGE: (), FREE: ()}
"""What can be told of a joint that is known from nothing but its motion: its line."""


class BodyParameters(Protocol):
    """A body as a vector of named parameters, whichever these are."""

    @property
    def base(self) -> BodyTree:
        """The body that they begin at."""
        ...

    @property
    def layout(self) -> "TreeParameters":
        """What derivatives are first taken by, see `by_name`."""
        ...

    @property
    def start(self) -> NDArray:
        """Where they begin. Shape (P,)."""
        ...

    @property
    def names(self) -> tuple[str, ...]:
        """Names of all parameters."""
        ...

    @property
    def index(self) -> dict[str, int]:
        """Position of each name."""
        ...

    @property
    def bends(self) -> slice:
        """Where what bends is, at the end."""
        ...

    @property
    def gears(self) -> slice | NDArray:
        """Where the gears are."""
        ...

    def tree_of(self, values: NDArray) -> BodyTree:
        """Return the body with these values. Shape (P,)."""
        ...

    def bending_of(self, values: NDArray) -> Bending | None:
        """Return what bends, as its names tell it."""
        ...

    def with_bending(self, bending: Bending | None) -> "BodyParameters":
        """Return the same of a body in which something else bends."""
        ...

    def layout_values(self, values: NDArray) -> NDArray:
        """Return the values of `layout`. Shape (P of it,)."""
        ...

    def by_name(self, values: NDArray, J: NDArray) -> NDArray:
        """Return derivatives by `names` of those by the names of `layout`. Shape (P, R)."""
        ...


@dataclass(frozen=True, eq=False)
class TreeParameters:
    """Names, values and derivatives of all that can be estimated of a body."""

    base: BodyTree
    """What the joints' turns and shifts are told from."""

    @property
    def names(self) -> tuple[str, ...]:
        """Names of all parameters."""
        return self._names

    @cached_property
    def _names(self) -> tuple[str, ...]:
        base = self.base
        frames = [*base.joints, *(self.attached[i].name for i in self.placed)]
        out = [f"{name}.{part}" for name in frames for part in FRAME_PARTS]
        out += [f"{name}.gear" for name in base.joints]
        inside = ((name, intrinsics_of(lens.lens)) for name, lens in base.lenses.items())
        out += [f"{name}.{part}" for name, parts in inside for part in parts]
        out += [name for mirror in base.mirrors for name in mirror.names]
        out += [f"{name}.{APART}" for name in base.contacts]
        return (*out, *(() if base.bending is None else base.bending.names))

    @property
    def start(self) -> NDArray:
        """Values of `base`. Shape (P,)."""
        return self.values_of(self.base)

    @property
    def layout(self) -> "TreeParameters":
        """What derivatives are first taken by: these themselves, see `by_name`."""
        return self

    def layout_values(self, values: NDArray) -> NDArray:
        """Return the values of `layout`. Shape (P,)."""
        return values

    def by_name(self, values: NDArray, J: NDArray) -> NDArray:
        """Return derivatives by `names` of those by the names of `layout`. Shape (P, R)."""
        return J

    def bending_of(self, values: NDArray) -> Bending | None:
        """Return what bends, as its names tell it."""
        bending = self.base.bending
        return None if bending is None else bending.with_values(values[self.bends])

    @cached_property
    def of_joint_frames(self) -> frozenset[str]:
        """Names of where the joints are on their parents' links."""
        return frozenset(self.names[: 6 * len(self.base.joints)])

    @cached_property
    def units(self) -> tuple[str, ...]:
        """Units of all parameters: `rad`, `m`, `1` or `px`."""
        base = self.base
        frames = (("rad",) * 3 + ("m",) * 3) * self.frame_count
        return (
            *frames,
            *("1",) * len(base.joints),
            *(unit for lens in base.lenses.values() for unit in intrinsic_units(lens.lens)),
            *MIRROR_UNITS * len(base.mirrors),
            *("m",) * len(base.contacts),
            *(() if base.bending is None else base.bending.units),
        )

    @property
    def index(self) -> dict[str, int]:
        """Position of each name."""
        return self._index

    @cached_property
    def _index(self) -> dict[str, int]:
        return {name: i for i, name in enumerate(self.names)}

    @property
    def attached(self) -> tuple[Attached, ...]:
        """Markers, then sensors, then planes."""
        return self.base.attached

    @cached_property
    def placed(self) -> tuple[int, ...]:
        """Which of `attached` have parameters: all but what is known on links that move freely."""
        free = {i for i, motion in enumerate(self.base.motions) if motion == FREE}
        return tuple(i for i, item in enumerate(self.attached) if item.on not in free)

    @cached_property
    def frame_of(self) -> NDArray:
        """Number of the frame of each of `attached`, -1 without parameters. Shape (a,)."""
        out = np.full(len(self.attached), -1)
        out[list(self.placed)] = len(self.base.joints) + np.arange(len(self.placed))
        return out

    @cached_property
    def frame_count(self) -> int:
        """How many frames have parameters, F."""
        return len(self.base.joints) + len(self.placed)

    @property
    def gears(self) -> slice:
        """Where the gears are."""
        return slice(6 * self.frame_count, 6 * self.frame_count + len(self.base.joints))

    @property
    def bends(self) -> slice:
        """Where what bends is, at the end."""
        bending = self.base.bending
        return slice(len(self.names) - (0 if bending is None else len(bending.names)), None)

    def intrinsics(self, camera: str) -> slice:
        """Return where a camera's intrinsics are.

        Raises:
            ValueError: If there is no such camera.
        """
        refuse_unknown("camera", camera, self._of_lens)
        return self._of_lens[camera]

    @cached_property
    def _of_lens(self) -> dict[str, slice]:
        """Where the intrinsics of each camera are."""
        counts = [len(intrinsics_of(lens.lens)) for lens in self.base.lenses.values()]
        ends = (self.gears.stop + np.cumsum(counts, dtype=int)).tolist()
        places = [slice(end - count, end) for end, count in zip(ends, counts, strict=True)]
        return dict(zip(self.base.lenses, places, strict=True))

    def mirror(self, name: str) -> slice:
        """Return where a mirror's plane is."""
        first = self.index[self.base.mirror(name).names[0]]
        return slice(first, first + len(MIRROR_PARTS))

    def contact(self, name: str) -> int:
        """Return where the distance of markers that touch is."""
        return self.index[f"{name}.{APART}"]

    @cached_property
    def of_lenses(self) -> frozenset[str]:
        """Names of all intrinsics."""
        return frozenset(n for lens in self.base.lenses for n in self.names[self.intrinsics(lens)])

    @cached_property
    def frames(self) -> NDArray:
        """What frames are told from: of joints with an axis and planes their own, or the identity.

        Shape (F, 4, 4).
        """
        out = np.tile(np.eye(4), (self.frame_count, 1, 1))
        axes = [i for i, motion in enumerate(self.base.motions) if motion not in WHOLE_POSES]
        out[axes] = self.base.X_PJ[axes]
        for k, plane in enumerate(self.base.planes, start=self.frame_count - len(self.base.planes)):
            out[k] = plane.X_LA
        return out

    def values_of(self, tree: BodyTree) -> NDArray:
        """Return the values of a body that has the base's joints, markers and sensors. (P,)."""
        attached = tree.attached
        X = np.stack([*tree.X_PJ, *(attached[i].X_LA for i in self.placed)])
        relative = inverse(self.frames) @ X
        parts = np.hstack([rotation_vectors_of(relative[:, :3, :3]), relative[:, :3, 3]])
        lenses = [tree.lenses[name].values for name in self.base.lenses]
        planes = [m.values_of(tree.mirror(m.name).plane) for m in self.base.mirrors]
        apart = np.array([tree.contacts[name] for name in self.base.contacts])
        bends = [] if tree.bending is None else [tree.bending.values]
        return np.concatenate([parts.ravel(), tree.gear, *lenses, *planes, apart, *bends])

    def tree_of(self, values: NDArray) -> BodyTree:
        """Return the body with these values. Shape (P,)."""
        base, n = self.base, len(self.base.joints)
        parts = values[: 6 * self.frame_count].reshape(-1, 6)
        X = self.frames @ transform(rotation_from_vector(parts[:, :3]), parts[:, 3:])
        moved = list(self.attached)
        for i, x in zip(self.placed, X[n:], strict=True):
            moved[i] = replace(moved[i], X_LA=x)
        lenses = {
            name: Camera.from_values(values[self.intrinsics(name)], lens.image_size, lens=lens.lens)
            for name, lens in base.lenses.items()
        }
        split = np.cumsum([len(base.markers), len(base.sensors)]).tolist()
        bending = None if base.bending is None else base.bending.with_values(values[self.bends])
        return replace(
            base,
            X_PJ=X[:n],
            gear=values[self.gears],
            markers=tuple(moved[: split[0]]),
            sensors=tuple(moved[split[0] : split[1]]),
            planes=tuple(moved[split[1] :]),
            lenses=lenses,
            bending=bending,
            mirrors=tuple(m.with_values(values[self.mirror(m.name)]) for m in base.mirrors),
            contacts={name: float(values[self.contact(name)]) for name in base.contacts},
        )

    def with_bending(self, bending: Bending | None) -> "TreeParameters":
        """Return the same of a body in which something else bends."""
        return TreeParameters(replace(self.base, bending=bending))

    def turn_slopes(self, values: NDArray) -> NDArray:
        """Return R0 J(w) of each frame: what a turn's parameters turn on its link. (F, 3, 3)."""
        parts = values[: 6 * self.frame_count].reshape(-1, 6)
        return self.frames[:, :3, :3] @ rotation_vector_slope(parts[:, :3])

    def retold(self, values: NDArray, names: Sequence[str]) -> NDArray:
        """Return what small changes are once they are told from the frames that values lead to.

        From X1 = X0 (exp(w), v), with exp(w + dw) = exp(w) exp(exp(w)' J dw):

            dw' = exp(w)' J(w) dw,  dv' = exp(w)' dv

        Only joints of which all six parts are named are retold: of a line two parts stay. Of planes
        those are that are named: the others do nothing.

        Args:
            values: Of all parameters. Shape (P,).
            names: What changes. Length k.

        Returns:
            Shape (k, k).
        """
        out, place = np.eye(len(names)), {name: i for i, name in enumerate(names)}
        for i, (joint, motion) in enumerate(zip(self.base.joints, self.base.motions, strict=True)):
            own = [place.get(f"{joint}.{part}", -1) for part in FRAME_PARTS]
            if motion in WHOLE_POSES or min(own) < 0:
                continue
            w = values[6 * i : 6 * i + 3]
            back = rotation_from_vector(w).T
            out[np.ix_(own[:3], own[:3])] = back @ rotation_vector_slope(w)
            out[np.ix_(own[3:], own[3:])] = back
        for plane in self.base.planes:
            names_of = [f"{plane.name}.{part}" for part in FRAME_PARTS]
            there = [k for k, name in enumerate(names_of) if name in place]
            own = [place[names_of[k]] for k in there]
            w = values[[self.index[name] for name in names_of[:3]]]
            both = np.zeros((6, 6))
            both[3:, 3:] = rotation_from_vector(w).T
            both[:3, :3] = both[3:, 3:] @ rotation_vector_slope(w)
            out[np.ix_(own, own)] = both[np.ix_(there, there)]
        return out

    def by_scale(self, values: NDArray) -> NDArray:
        """Return derivatives by the logarithm of the body's size: no camera sees it. Shape (P,).

        Args:
            values: Of all parameters. Shape (P,).
        """
        return self.values_of(self.tree_of(values).scaled(2.0)) - values

    def line_of(self, joint: str) -> frozenset[str]:
        """Return the names of what a joint's own motion tells of it."""
        motion = self.base.motions[self.base.joints.index(joint)]
        return frozenset(f"{joint}.{part}" for part in _LINE[motion])

    def scales(self, size: float, values: NDArray) -> NDArray:
        """Return the natural size of each parameter, on which a sigma says if it is known at all.

        Args:
            size: Of the body [m].
            values: Of the parameters; the gear's own size is its scale. Shape (P,).

        Returns:
            Shape (P,).
        """
        by_unit: Mapping[str, float] = {"m": size, "rad": 1.0, "px": 1000.0, "1": 1.0}
        by_unit = {**by_unit, "rad/m": 1.0 / size}
        out = np.array([by_unit[unit] for unit in self.units])
        out[self.gears] = np.abs(values[self.gears])
        return out
