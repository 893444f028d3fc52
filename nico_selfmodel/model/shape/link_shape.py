"""The outer surfaces of links as they were learned."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.arrays import frozen_array, read_only
from nico_selfmodel.errors import ModelError
from nico_selfmodel.geometry.transform import check_rigid
from nico_selfmodel.geometry.triangle_mesh import TriangleMesh
from nico_selfmodel.names import check_name, listed

COLOR_STEPS = 255
"""Colours are told to one part of this, as pixels are."""


@dataclass(frozen=True, eq=False)
class LinkShape:
    """A link's surface; where it ends, nothing is known of the link."""

    link: str
    """Name of the link."""
    mesh: TriangleMesh
    """In the link's frame."""
    sigma: NDArray
    """Of each vertex along its normal [m]; nan where it was never seen. Shape (V,)."""
    colors: NDArray
    """Red, green and blue of each vertex, of 1, in the light in which it was seen, to 1/255; nan
    where it was never seen. Shape (V, 3)."""
    looks: NDArray
    """Pictures that show each vertex or its outline. Shape (V,)."""
    seen: NDArray
    """Whether enough of them do for its place to be claimed. Other vertices are where outlines and
    neighbours leave room for them, and count as never seen. Shape (V,)."""

    def __post_init__(self) -> None:
        """Check the numbers and make the arrays read-only.

        Raises:
            ValueError: If the name cannot be shown, shapes differ, or what was seen lacks a sigma
                or a colour from 0 to 1.
        """
        check_name(self.link, "the name of a link")
        size = len(self.mesh.vertices)
        seen = np.asarray(self.seen)
        if seen.dtype != bool or seen.shape != (size,):
            raise ValueError(f"seen must be truth values of shape ({size},), got {seen.shape}")
        looks = frozen_array(self.looks, (size,), "looks")
        if (looks < 0.0).any() or not np.array_equal(looks, np.round(looks)):
            raise ValueError("looks must be whole numbers, 0 or more")
        for name, shape in (("sigma", (size,)), ("colors", (size, 3))):
            object.__setattr__(self, name, _of_seen(getattr(self, name), seen, shape, name))
        object.__setattr__(self, "looks", read_only(looks, np.int64))
        object.__setattr__(self, "seen", read_only(seen))
        if not (self.sigma[seen] > 0.0).all():
            raise ValueError(f"sigma must be positive, got {self.sigma[seen].min():g} m")
        if not ((self.colors[seen] >= 0.0) & (self.colors[seen] <= 1.0)).all():
            raise ValueError("colors must be from 0 to 1")
        rounded = np.round(COLOR_STEPS * self.colors) / COLOR_STEPS
        object.__setattr__(self, "colors", read_only(rounded))

    @property
    def seen_part(self) -> "LinkShape":
        """What is claimed: triangles of which all corners were seen, and these corners alone."""
        used = self.mesh.used(self.seen)
        return LinkShape(
            self.link,
            self.mesh.of_vertices(self.seen),
            self.sigma[used],
            self.colors[used],
            self.looks[used],
            self.seen[used],
        )


@dataclass(frozen=True, eq=False)
class BodyShape:
    """The surfaces of links, and where these stood when they were seen."""

    links: Mapping[str, LinkShape]
    """By name of the link."""
    X_WF: Mapping[str, NDArray]
    """Link -> its pose in the world of the self-model when it was seen. Shape (4, 4) each."""

    def __post_init__(self) -> None:
        """Check the names, and make mappings and poses read-only.

        Raises:
            ValueError: If a link has another name than its shape, or no rigid pose.
        """
        strange = [name for name, shape in self.links.items() if shape.link != name]
        if strange or set(self.X_WF) != set(self.links):
            raise ValueError(
                f"a shape and a pose of each link are needed, got shapes of {sorted(self.links)} "
                f"and poses of {sorted(self.X_WF)}"
            )
        object.__setattr__(self, "links", MappingProxyType(dict(self.links)))
        poses = {name: _rigid(self.X_WF[name], f"X_WF of {name}") for name in self.links}
        object.__setattr__(self, "X_WF", MappingProxyType(poses))

    def check_links(self, links: Iterable[str]) -> None:
        """Refuse a robot that lacks some of the links.

        Raises:
            ModelError: In that case.
        """
        there = list(links)
        if strange := [link for link in self.links if link not in there]:
            raise ModelError(
                f"the learned shape is of {listed(strange)}, the robot has the links "
                f"{listed(there)}: take the shape that was learned with this self-model"
            )


def _of_seen(value: NDArray, seen: NDArray, shape: tuple[int, ...], name: str) -> NDArray:
    """Return a read-only copy that is finite where something was seen and nan elsewhere."""
    array = np.array(value, dtype=float)
    if array.shape != shape:
        raise ValueError(f"{name} must have shape {shape}, got {array.shape}")
    array[~seen] = np.nan
    if not np.isfinite(array[seen]).all():
        raise ValueError(f"{name} must be finite wherever a vertex was seen")
    return read_only(array)


def _rigid(value: NDArray, name: str) -> NDArray:
    """Return a read-only copy of a rigid pose."""
    pose = frozen_array(value, (4, 4), name)
    check_rigid(pose, name, 1e-6)
    return pose
