"""A body: a tree of joints, and what is fixed to its links (markers, cameras, trackers)."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from nico_selfmodel.arrays import frozen_array, read_only
from nico_selfmodel.model.arm.bending import Bending
from nico_selfmodel.model.cameras.camera import Camera
from nico_selfmodel.model.tree.standing_mirror import StandingMirror
from nico_selfmodel.names import listed, refuse_unknown

WORLD, WORLD_NAME = -1, "world"
"""What is `on` no link is on the world."""
REVOLUTE, PRISMATIC, FLANGE, FREE = "revolute", "prismatic", "flange", "free"
MOTIONS = (REVOLUTE, PRISMATIC, FLANGE, FREE)
"""How a joint moves: about its z axis, along it, by the whole pose that a controller reads, or
anywhere, as a board in a hand, whose pose is learned anew in each sample."""
WHOLE_POSES = (FLANGE, FREE)
"""Motions that are a whole pose, not a turn about an axis or a shift along one."""


@dataclass(frozen=True, eq=False)
class Attached:
    """A frame fixed to a link: a marker, a camera, a tracker."""

    name: str
    """Its name."""
    on: int
    """Index of the joint whose link carries it; `WORLD` for the world."""
    X_LA: NDArray = field(default_factory=lambda: np.eye(4))
    """Its pose on the link [m]. Shape (4, 4)."""
    oriented: bool = True
    """Whether its orientation means anything; a point has none."""

    def __post_init__(self) -> None:
        """Make the pose read-only."""
        object.__setattr__(self, "X_LA", frozen_array(self.X_LA, (4, 4), f"pose of {self.name}"))


@dataclass(frozen=True, eq=False)
class BodyTree:
    """Joints with their parents, gears and couplings, markers and sensors.

    Link i moves with joint i: X_WL_i = X_WL_parent X_PJ_i M(q_i), M a turn about z, a shift along
    z, or a whole pose. Only a line is told of a joint by what moves with it: turning or
    shifting X_PJ along z is the same as another zero of q, taken up by all that follows.
    """

    joints: tuple[str, ...]
    """Names; a parent comes before its children. Length n."""
    motions: tuple[str, ...]
    """How each moves, of `MOTIONS`. Length n."""
    parent: NDArray
    """Index of the joint whose link carries it, `WORLD` at a root. Shape (n,)."""
    X_PJ: NDArray
    """Joint frames on their parents' links [m]; z is the axis. Shape (n, 4, 4)."""
    gear: NDArray
    """Encoder per joint angle (or rad per m of a prismatic joint with counts). Shape (n,)."""
    coupling: NDArray
    """Displacements of all joints by those that are read: q = coupling q_read. A joint without an
    encoder has its ratios here, any other a 1 of its own. Shape (n, n)."""
    markers: tuple[Attached, ...]
    """What is seen."""
    sensors: tuple[Attached, ...]
    """What sees: cameras and trackers."""
    lenses: Mapping[str, Camera] = field(default_factory=dict)
    """Intrinsics of the sensors that are cameras; their own poses are not used."""
    bending: Bending | None = None
    """What bends, of all joints; only those that turn bend. Nothing if None."""
    mirrors: tuple[StandingMirror, ...] = ()
    """What it sees itself in, fixed in the world."""
    planes: tuple[Attached, ...] = ()
    """What its markers touch: each the plane z = 0 of a frame."""
    contacts: Mapping[str, float] = field(default_factory=dict)
    """How far apart two markers are where they touch, by name [m]."""

    def __post_init__(self) -> None:
        """Check that it is a tree, and make the arrays read-only."""
        n = len(self.joints)
        names = self.names
        if len(set(names)) < len(names):
            twice = sorted({name for name in names if names.count(name) > 1})
            raise ValueError(f"names must be unique in a body, got {listed(twice)} more than once")
        known = [mirror.name for mirror in self.mirrors]
        if len(set(known)) < len(known):
            raise ValueError(f"names of mirrors must be unique, got {listed(known)}")
        parent = read_only(self.parent, int)
        if parent.shape != (n,) or (parent >= np.arange(n)).any() or (parent < WORLD).any():
            raise ValueError(f"a parent must come before its children, got parents {parent}")
        for attached in self.attached:
            if not WORLD <= attached.on < n:
                raise ValueError(f"{attached.name} is on joint {attached.on} of {n}")
        if len(self.motions) != n or set(self.motions) - set(MOTIONS):
            raise ValueError(f"motions must be {n} of {', '.join(MOTIONS)}, got {self.motions}")
        if self.bending is not None and self.bending.joints != self.joints:
            raise ValueError(f"what bends has other joints than the body: {self.bending.joints}")
        object.__setattr__(self, "parent", parent)
        object.__setattr__(self, "X_PJ", frozen_array(self.X_PJ, (n, 4, 4), "X_PJ"))
        object.__setattr__(self, "gear", frozen_array(self.gear, (n,), "gear"))
        object.__setattr__(self, "coupling", frozen_array(self.coupling, (n, n), "coupling"))

    @property
    def names(self) -> tuple[str, ...]:
        """Of joints, markers, sensors, planes and contacts."""
        return (*self.joints, *(item.name for item in self.attached), *self.contacts)

    @property
    def attached(self) -> tuple[Attached, ...]:
        """Frames on links: of markers, then sensors, then planes."""
        return (*self.markers, *self.sensors, *self.planes)

    @cached_property
    def X_attached(self) -> NDArray:
        """Their poses on their links [m]. Shape (a, 4, 4)."""
        return np.stack([item.X_LA for item in self.attached])

    @property
    def beyond(self) -> NDArray:
        """Which joints move each link: entry (l, i) whether joint i moves link l.

        Boolean, shape (n + 1, n); the last row is the world's, so that `WORLD` indexes it.
        """
        n = len(self.joints)
        moved = np.zeros((n + 1, n), dtype=bool)
        for i, parent in enumerate(self.parent.tolist()):
            moved[i] = moved[parent]
            moved[i, i] = True
        return moved

    def link_name(self, link: int) -> str:
        """Return the name of the joint that moves a link; `WORLD_NAME` for `WORLD`."""
        return WORLD_NAME if link == WORLD else self.joints[link]

    def marker_index(self, name: str) -> int:
        """Return the position of a marker.

        Raises:
            ValueError: If there is no such marker; the message lists those there are.
        """
        names = [marker.name for marker in self.markers]
        refuse_unknown("marker", name, names)
        return names.index(name)

    def displacements(self, readings: ArrayLike) -> NDArray:
        """Return the displacement of all joints, q = coupling (readings / gear).

        Args:
            readings: Encoder angles [rad] or lengths [m], floats or Drake's scalars; zero where a
                joint has no encoder. Shape (N, n).

        Returns:
            Shape (N, n).
        """
        return np.asarray((np.asarray(readings) / self.gear) @ self.coupling.T)

    def camera(self, name: str) -> Camera:
        """Return a camera with its pose on its link."""
        (at,) = [sensor.X_LA for sensor in self.sensors if sensor.name == name]
        return self.lenses[name].at(at)

    def mirror(self, name: str) -> StandingMirror:
        """Return a mirror.

        Raises:
            ValueError: If there is none of that name; the message lists those there are.
        """
        for mirror in self.mirrors:
            if mirror.name == name:
                return mirror
        known = [mirror.name for mirror in self.mirrors]
        raise ValueError(f"no mirror {name!r}; the body knows {listed(known, name) or 'none'}")

    def with_mirrors(self, mirrors: tuple[StandingMirror, ...]) -> "BodyTree":
        """Return the same body with mirrors; of those it has, others are kept."""
        new = {mirror.name for mirror in mirrors}
        kept = tuple(mirror for mirror in self.mirrors if mirror.name not in new)
        return replace(self, mirrors=(*kept, *mirrors))

    def with_markers(self, markers: tuple[Attached, ...]) -> "BodyTree":
        """Return the same body with other markers."""
        return replace(self, markers=markers)

    def scaled(self, factor: float) -> "BodyTree":
        """Return the body that looks the same to every camera, so many times as large.

        Prismatic joints must not be read in metres, flanges not at all: both know their scale.
        """

        def larger(X: NDArray) -> NDArray:
            out = np.array(X)
            out[..., :3, 3] *= factor
            return out

        def of(items: tuple[Attached, ...]) -> tuple[Attached, ...]:
            return tuple(replace(item, X_LA=larger(item.X_LA)) for item in items)

        return replace(
            self,
            X_PJ=larger(self.X_PJ),
            markers=of(self.markers),
            sensors=of(self.sensors),
            mirrors=tuple(mirror.scaled(factor) for mirror in self.mirrors),
            planes=of(self.planes),
            contacts={name: factor * apart for name, apart in self.contacts.items()},
        )
