"""What a scene is made of: shapes with a path, a colour and a pose; no viewer in it."""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.arrays import as_floats, frozen_array
from nico_selfmodel.viz.figures.rgba import Rgba

MARKER_SHAPES = ("sphere", "diamond")
IMAGE_KINDS = {b"\x89PNG": "image/png", b"\xff\xd8\xff": "image/jpeg"}
"""First bytes of a file -> its MIME type."""
_SIZES = ("radius", "length", "width", "height")
"""Fields of any item that are positive lengths [m]."""
_THREE_SIZES = ("sides", "radii")
"""Those that are three of them."""
_LISTS = ("centers", "starts", "points", "vertices")
"""Those that are points, each with an end or a colour where an item has these."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Item:
    """A shape in a scene."""

    path: str
    """Names from the root of the scene down, joined by `/`; unique in a scene."""
    color: Rgba
    """Red, green, blue and opacity, 0 to 1."""
    X_WI: NDArray = field(default_factory=lambda: np.eye(4))
    """Pose of the item's own frame I in the scene's frame W. Shape (4, 4)."""

    def __post_init__(self) -> None:
        """Check path, colour, pose and sizes, and make the arrays read-only."""
        parts = self.path.split("/")
        if not all(parts) or any(part != part.strip() for part in parts):
            raise ValueError(f"path must be names joined by '/', got {self.path!r}")
        color = tuple(as_floats(self.color, "color").ravel().tolist())
        if len(color) != 4 or not all(0.0 <= c <= 1.0 for c in color):
            raise ValueError(f"color must be four numbers from 0 to 1, got {self.color}")
        object.__setattr__(self, "color", color)
        self._freeze("X_WI", (4, 4))
        for name in filter(self._has, _SIZES):
            value = as_floats(getattr(self, name), name)
            if value.shape != () or not (np.isfinite(value) and value > 0.0):
                raise ValueError(f"{name} must be positive, got {value}")
            object.__setattr__(self, name, float(value))
        for name in filter(self._has, _THREE_SIZES):
            self._freeze(name, (3,))
            if np.any(getattr(self, name) <= 0.0):
                raise ValueError(f"{name} must be positive, got {getattr(self, name)}")
        for name in filter(self._has, _LISTS):
            count = self._freeze_list(name)
            for other in filter(self._has, ("ends", "colors")):
                self._freeze(other, (count, 3))

    def _has(self, name: str) -> bool:
        return getattr(self, name, None) is not None

    def _freeze(self, name: str, shape: tuple[int, ...]) -> None:
        object.__setattr__(self, name, frozen_array(getattr(self, name), shape, name))

    def _freeze_list(self, name: str) -> int:
        """Freeze a list of points of any length, and return its length."""
        value = as_floats(getattr(self, name), name)
        if value.ndim != 2 or value.shape[1] != 3 or not len(value):
            raise ValueError(f"{name} must have shape (n >= 1, 3), got {value.shape}")
        self._freeze(name, value.shape)
        return len(value)


@dataclass(frozen=True, eq=False, kw_only=True)
class Markers(Item):
    """Equal small shapes at many points."""

    centers: NDArray
    """In I [m]. Shape (n, 3)."""
    radius: float
    """[m]."""
    colors: NDArray | None = None
    """Red, green, blue of each, in place of that of `color`. Shape (n, 3)."""
    shape: str = "sphere"
    """One of `MARKER_SHAPES`."""

    def __post_init__(self) -> None:
        """Check and freeze."""
        super().__post_init__()
        if self.shape not in MARKER_SHAPES:
            raise ValueError(f"shape must be one of {', '.join(MARKER_SHAPES)}, got {self.shape!r}")


@dataclass(frozen=True, eq=False, kw_only=True)
class Needles(Item):
    """Vectors, thick where they start and ending in a point."""

    starts: NDArray
    """In I [m]. Shape (n, 3)."""
    ends: NDArray
    """In I [m]. Shape (n, 3)."""
    radius: float
    """At the start [m]."""
    colors: NDArray | None = None
    """Red, green, blue of each, in place of that of `color`. Shape (n, 3)."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Segments(Item):
    """Hair lines, one pixel wide in every browser."""

    starts: NDArray
    """In I [m]. Shape (n, 3)."""
    ends: NDArray
    """In I [m]. Shape (n, 3)."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Tube(Item):
    """A round wire along points."""

    points: NDArray
    """In I [m]; neighbours differ. Shape (n >= 2, 3)."""
    radius: float
    """[m]."""
    closed: bool = False
    """Whether the last point is joined to the first."""

    def __post_init__(self) -> None:
        """Check and freeze."""
        super().__post_init__()
        if len(self.points) < 2:
            raise ValueError("a tube needs at least two points")


@dataclass(frozen=True, eq=False, kw_only=True)
class Box(Item):
    """A box along the axes of I, centred."""

    sides: NDArray
    """Lengths along x, y, z [m]. Shape (3,)."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Cylinder(Item):
    """A cylinder along z of I, centred."""

    radius: float
    """[m]."""
    length: float
    """[m]."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Capsule(Item):
    """A cylinder along z of I, centred, with a half sphere on each end."""

    radius: float
    """[m]."""
    length: float
    """Between the centres of the half spheres [m]."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Ellipsoid(Item):
    """An ellipsoid along the axes of I; a sphere where its radii are equal."""

    radii: NDArray
    """Half axes [m]. Shape (3,)."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Triad(Item):
    """The axes of I, x red, y green, z blue; only the opacity of `color` is used."""

    length: float
    """Of each axis [m]."""
    radius: float
    """Of each axis [m]."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Surface(Item):
    """Triangles, seen from both sides."""

    vertices: NDArray
    """In I [m]. Shape (v, 3)."""
    faces: NDArray
    """Indices of the vertices of each triangle. Shape (f, 3)."""
    colors: NDArray | None = None
    """Red, green, blue of each vertex, in place of that of `color`. Shape (v, 3)."""

    def __post_init__(self) -> None:
        """Check and freeze."""
        super().__post_init__()
        count = len(self.vertices)
        faces = np.array(self.faces, dtype=np.int32)
        if faces.ndim != 2 or faces.shape[1] != 3 or not len(faces):
            raise ValueError(f"faces must have shape (f >= 1, 3), got {faces.shape}")
        if faces.min() < 0 or faces.max() >= count:
            raise ValueError(f"faces must name vertices 0 to {count - 1}, got {faces.max()}")
        faces.flags.writeable = False
        object.__setattr__(self, "faces", faces)


@dataclass(frozen=True, eq=False, kw_only=True)
class Picture(Item):
    """An image on a rectangle in the plane z = 0 of I, centred, shown as it is in any light.

    x of I is the image's right and y its down, so that it is seen the right way round along z, as
    a camera sees. Only the opacity of `color` is used.
    """

    width: float
    """Along x [m]."""
    height: float
    """Along y [m]."""
    image: bytes
    """A PNG or JPEG file."""

    def __post_init__(self) -> None:
        """Check and freeze."""
        super().__post_init__()
        object.__setattr__(self, "image", bytes(self.image))
        if not self.image.startswith(tuple(IMAGE_KINDS)):
            raise ValueError(f"image must be a PNG or JPEG file, it begins {self.image[:8]!r}")

    @property
    def image_kind(self) -> str:
        """`image/png` or `image/jpeg`."""
        return next(kind for start, kind in IMAGE_KINDS.items() if self.image.startswith(start))

    @property
    def corners(self) -> NDArray:
        """Top left, top right, bottom right and bottom left in I [m]. Shape (4, 3)."""
        x, y = 0.5 * self.width, 0.5 * self.height
        return np.array([[-x, -y, 0.0], [x, -y, 0.0], [x, y, 0.0], [-x, y, 0.0]])


_SHAPES = (Markers, Needles, Segments, Tube, Box, Cylinder, Capsule, Ellipsoid, Triad)
ITEM_KINDS: dict[str, type[Item]] = {
    kind.__name__.lower(): kind for kind in (*_SHAPES, Surface, Picture)
}
"""Name in files -> class."""
