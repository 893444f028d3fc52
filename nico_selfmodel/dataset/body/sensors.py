"""What is seen of a body and what sees it, as a data set lists them."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.dataset.body.link_joint import LinkJoint
from nico_selfmodel.errors import DataError
from nico_selfmodel.files.yaml_mapping import check_keys, number_value, text_value
from nico_selfmodel.geometry.rotation import rotation_from_vector, rotation_vector_of
from nico_selfmodel.geometry.transform import transform
from nico_selfmodel.model.cameras.camera import Camera
from nico_selfmodel.model.cameras.projection import LENSES, POLYNOMIAL, intrinsics_of
from nico_selfmodel.model.tree.body_tree import FREE, WORLD_NAME
from nico_selfmodel.names import check_name, listed, shown

POINTS, POSES, CAMERA = "points", "poses", "camera"
DISTANCE, CONTACT, PLANE = "distance", "contact", "plane"
SENSOR_COLUMNS: Mapping[str, tuple[str, ...]] = {
    POINTS: ("x_m", "y_m", "z_m"),
    POSES: ("x_m", "y_m", "z_m", "rx", "ry", "rz"),
    CAMERA: ("u", "v"),
    DISTANCE: ("distance_m",),
    CONTACT: (),
    PLANE: (),
}
"""What each kind of sensor measures: points, whole poses (rotation vector of the marker in the
sensor's frame), pixels, the distance of two markers. That two markers are as far apart as in all
its rows, and that a marker lies in a plane, needs no number."""
SIGHTS = (POINTS, POSES, CAMERA)
"""Kinds that tell where a marker is."""
TOUCHES = (DISTANCE, CONTACT, PLANE)
"""Kinds that tell how it is to another, or to what it touches."""
PAIRS = (DISTANCE, CONTACT)
"""Kinds whose observations are of two markers."""
FIRST_SIGMA = {POINTS: 1e-3, POSES: 1e-3, CAMERA: 0.5, DISTANCE: 1e-3, CONTACT: 1e-3, PLANE: 1e-3}
"""Standard deviations with which an unknown noise is first taken [m or px]."""
FIRST_TURN_SIGMA = 0.01
"""That of a measured orientation [rad]."""
_KEYS = (
    "name", "kind", "on", "sigma_m", "sigma_px", "sigma_rad", "image_size", "lens", "pose", "noise",
)  # fmt: skip
_POSE_SIGMAS = ("sigma_m", "sigma_rad")
"""What says of a sensor's pose that it is known, and by how much."""
_LIMIT = {CAMERA: 100.0}
"""Largest standard deviation of a kind that is not 1 m."""
_SHORTEST = 0.05
"""Part of an image's longer side below which no focal length of any lens lies."""


@dataclass(frozen=True)
class MarkerInfo:
    """A point, or a frame, that is fixed to a link and seen."""

    name: str
    """Its name, unique in the body."""
    on: str
    """The joint whose link carries it, or `world`."""
    xyz: tuple[float, float, float] | None = None
    """Its place there, where that is known for sure [m]."""

    @classmethod
    def from_mapping(cls, entry: Any, where: str) -> "MarkerInfo":
        """Make a marker from its entry in a YAML file.

        Raises:
            DataError: If the entry is not valid.
        """
        if not isinstance(entry, Mapping):
            raise DataError(f"{where}: a marker must be {{name, on}}, got {shown(entry)}")
        check_keys(entry, ("name", "on", "xyz"), where)
        name = text_value(entry, "name", where)
        try:
            check_name(name, "a marker")
        except ValueError as error:
            raise DataError(f"{where}: {error}") from None
        if entry.get("on") is None:
            raise DataError(f"{where}: marker {name!r} is on no link: add 'on', a joint or 'world'")
        return cls(name, text_value(entry, "on", where), _place(entry.get("xyz"), where))

    def to_mapping(self) -> dict[str, Any]:
        """Return the entry of this marker in a YAML file."""
        place = {} if self.xyz is None else {"xyz": list(self.xyz)}
        return {"name": self.name, "on": self.on, **place}


@dataclass(frozen=True, eq=False)
class SensorInfo:
    """What measures markers, with what is known of it."""

    name: str
    """Its name, unique in the body."""
    kind: str
    """`points`, `poses`, `camera`, `distance`, `contact` or `plane`."""
    on: str = WORLD_NAME
    """The joint whose link carries it, or `world`."""
    sigma: float | None = None
    """Standard deviation of a coordinate [m or px]; estimated where it is not given."""
    turn_sigma: float | None = None
    """That of each part of an orientation [rad], of `poses`."""
    image_size: tuple[int, int] | None = None
    """Width and height [px], of a camera."""
    lens: Mapping[str, float] | None = None
    """Known intrinsics of a camera, by the names of `intrinsics_of` its lens."""
    lens_kind: str = POLYNOMIAL
    """Of a camera, one of `LENSES`."""
    X_LS: NDArray | None = None
    """Where it is thought to be on its link; a guess, of a plane what its tilts are told from, too.
    Shape (4, 4)."""
    pose_sigma: tuple[float, float] | None = None
    """What each part of the place [m] and turn [rad] in `X_LS` is uncertain by, where it is known;
    None where `X_LS` is a guess."""
    noise: str = ""
    """Sensors that say the same here share their standard deviations; its own name if empty."""

    @property
    def camera(self) -> Camera | None:
        """The camera with its known lens; None where it is none, or its lens is not known."""
        if self.kind != CAMERA or self.lens is None or self.image_size is None:
            return None
        values = np.array([self.lens.get(name, 0.0) for name in intrinsics_of(self.lens_kind)])
        return Camera.from_values(values, self.image_size, lens=self.lens_kind)

    @classmethod
    def from_mapping(cls, entry: Any, where: str) -> "SensorInfo":
        """Make a sensor from its entry in a YAML file.

        Raises:
            DataError: If the entry is not valid.
        """
        if not isinstance(entry, Mapping):
            raise DataError(f"{where}: a sensor must be {{name, kind, ...}}, got {shown(entry)}")
        check_keys(entry, _KEYS, where)
        name, kind = text_value(entry, "name", where), text_value(entry, "kind", where)
        if kind not in SENSOR_COLUMNS:
            raise DataError(
                f"{where}: the kind of sensor {name!r} must be one of "
                f"{', '.join(SENSOR_COLUMNS)}, got {shown(kind)}"
            )
        sigma = number_value(entry, "sigma_px" if kind == CAMERA else "sigma_m", where)
        turn = number_value(entry, "sigma_rad", where)
        for key, value in (("sigma", sigma), ("sigma_rad", turn)):
            limit = _LIMIT.get(kind, 1.0)
            if value is not None and not 1e-9 <= value <= limit:
                raise DataError(
                    f"{where}: {key} of sensor {name!r} must be between 1e-9 and "
                    f"{limit:g}, got {value:g}; leave it out where it is not known"
                )
        size = entry.get("image_size")
        if size is not None and not _is_size(size):
            raise DataError(f"{where}: 'image_size' must be [width, height], got {shown(size)}")
        lens = _lens(entry.get("lens"), where)
        if lens and size and min(lens["fx"], lens["fy"]) < _SHORTEST * max(size):
            raise DataError(
                f"{where}: fx {lens['fx']:g} and fy {lens['fy']:g} of sensor {name!r} are no focal "
                f"lengths of images of {size[0]} x {size[1]}: give them in pixels"
            )
        return cls(
            name,
            kind,
            text_value(entry, "on", where, WORLD_NAME),
            sigma,
            turn,
            None if size is None else (size[0], size[1]),
            lens,
            X_LS=_pose(entry.get("pose"), where),
            pose_sigma=_pose_sigma(entry.get("pose"), kind, where),
            lens_kind=_lens_kind(entry.get("lens"), where),
            noise=text_value(entry, "noise", where, ""),
        )

    def to_mapping(self) -> dict[str, Any]:
        """Return the entry of this sensor in a YAML file."""
        entry: dict[str, Any] = {"name": self.name, "kind": self.kind, "on": self.on}
        entry["sigma_px" if self.kind == CAMERA else "sigma_m"] = self.sigma
        entry["sigma_rad"] = self.turn_sigma
        entry["image_size"] = None if self.image_size is None else list(self.image_size)
        kind = {} if self.lens_kind == POLYNOMIAL else {"kind": self.lens_kind}
        entry["lens"] = None if self.lens is None else kind | dict(self.lens)
        if self.X_LS is not None:
            sigmas = dict(zip(_POSE_SIGMAS, self.pose_sigma or (), strict=False))
            entry["pose"] = {**_pose_mapping(self.X_LS), **sigmas}
        entry["noise"] = self.noise or None
        return {key: value for key, value in entry.items() if value is not None}


def _pose_mapping(X: NDArray) -> dict[str, list[float]]:
    """Return a pose as files hold it: `xyz` [m] and `rotation_vector` [rad]."""
    turn = rotation_vector_of(X[:3, :3])
    return {"xyz": np.asarray(X)[:3, 3].tolist(), "rotation_vector": turn.tolist()}


def _pose(value: Any, where: str) -> NDArray | None:
    if value is None:
        return None
    if not isinstance(value, Mapping):
        raise DataError(f"{where}: 'pose' must have xyz and rotation_vector, got {shown(value)}")
    check_keys(value, ("xyz", "rotation_vector", *_POSE_SIGMAS), where)
    parts = [np.asarray(value.get(key, [0.0] * 3)) for key in ("xyz", "rotation_vector")]
    if any(part.shape != (3,) or part.dtype.kind not in "if" for part in parts):
        raise DataError(f"{where}: 'pose' needs three numbers each, got {shown(value)}")
    if not np.isfinite(np.concatenate(parts)).all():
        raise DataError(f"{where}: 'pose' must be finite, got {shown(value)}")
    return transform(rotation_from_vector(parts[1]), parts[0])


def _pose_sigma(pose: Any, kind: str, where: str) -> tuple[float, float] | None:
    """Return what a pose that was read is uncertain by; None where it is a guess."""
    if pose is None or not any(key in pose for key in _POSE_SIGMAS):
        return None
    place, turn = (number_value(pose, key, where) for key in _POSE_SIGMAS)
    if place is None or turn is None or min(place, turn) < 0.0 or kind not in SIGHTS:
        raise DataError(
            f"{where}: a 'pose' that is known has sigma_m and sigma_rad, 0 or more, and is of a "
            f"sensor that sees, got {shown(pose)} of kind {kind!r}; leave both out of a guess"
        )
    return place, turn


def _place(value: Any, where: str) -> tuple[float, float, float] | None:
    if value is None:
        return None
    place = np.asarray(value if isinstance(value, list) else [])
    if place.shape != (3,) or place.dtype.kind not in "if" or not np.isfinite(place).all():
        raise DataError(f"{where}: 'xyz' must be three numbers [m], got {shown(value)}")
    x, y, z = place.astype(float).tolist()
    return x, y, z


def _lens(value: Any, where: str) -> dict[str, float] | None:
    if value is None:
        return None
    if not isinstance(value, Mapping):
        raise DataError(f"{where}: 'lens' must be fx, fy, cx, cy, ..., got {shown(value)}")
    names = intrinsics_of(_lens_kind(value, where))
    check_keys(value, ("kind", *names), where)
    found = {str(key): number_value(value, key, where) or 0.0 for key in value if key != "kind"}
    lacking = [key for key in ("fx", "fy", "cx", "cy") if key not in found]
    if lacking:
        raise DataError(f"{where}: a lens needs {listed(lacking)}, got {shown(dict(value))}")
    if not (found["fx"] > 0.0 and found["fy"] > 0.0):
        raise DataError(f"{where}: a lens needs positive fx and fy, got {shown(dict(value))}")
    return found


def _lens_kind(value: Any, where: str) -> str:
    kind = value.get("kind", POLYNOMIAL) if isinstance(value, Mapping) else POLYNOMIAL
    if kind not in LENSES:
        raise DataError(
            f"{where}: the kind of a lens must be one of {', '.join(LENSES)}, got {shown(kind)}"
        )
    return kind


def _is_size(size: Any) -> bool:
    whole = isinstance(size, list) and len(size) == 2
    return whole and all(type(side) is int and 0 < side < 10**6 for side in size)


def check_free_joints(
    joints: Sequence[LinkJoint], markers: Sequence[MarkerInfo], sensors: Sequence[SensorInfo]
) -> None:
    """Refuse free joints whose pose nothing could tell.

    Raises:
        DataError: If one stands before others, is carried, carries a sensor or a marker of unknown
            place.
    """
    for i, joint in enumerate(joints):
        if joint.motion != FREE:
            continue
        if any(later.motion != FREE for later in joints[i:]):
            raise DataError(f"joint {joint.name!r} moves freely: list such joints after all others")
        if joint.parent != WORLD_NAME:
            raise DataError(
                f"joint {joint.name!r} moves freely, so its parent must be {WORLD_NAME!r}, got "
                f"{joint.parent!r}"
            )
        riding = [s.name for s in sensors if s.on == joint.name]
        if riding:
            raise DataError(
                f"sensors {listed(riding)} are on {joint.name!r}, which moves freely: nothing "
                "tells where they are; let it be a joint with motion 'flange', whose pose is read"
            )
        unknown = [m.name for m in markers if m.on == joint.name and m.xyz is None]
        if unknown:
            raise DataError(
                f"markers {listed(unknown)} are on {joint.name!r}, which moves freely: their "
                "places there must be known ('xyz'), as those of a board's corners are"
            )
