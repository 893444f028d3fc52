"""A learned body with its error bars, in memory and as one YAML: `format: nico-body/1`."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.arrays import read_only
from nico_selfmodel.errors import DataError, ModelError
from nico_selfmodel.files.folder_contents import found_at, warn_of_failure
from nico_selfmodel.files.reading import LARGEST_BODY, read_text
from nico_selfmodel.files.whole import write_whole
from nico_selfmodel.files.yaml_text import parse_yaml, yaml_text
from nico_selfmodel.geometry.plane import Plane
from nico_selfmodel.geometry.transform import check_rigid
from nico_selfmodel.model.arm.bending_document import bending_document, bending_of
from nico_selfmodel.model.cameras.camera import Camera
from nico_selfmodel.model.cameras.projection import POLYNOMIAL, intrinsics_of
from nico_selfmodel.model.document_values import (
    damage,
    last_mapping,
    mapping,
    mappings,
    numbers,
    texts,
)
from nico_selfmodel.model.self_model import ParameterCovariance
from nico_selfmodel.model.tree.body_check import (
    check_joint,
    check_parameters,
    checked_contacts,
    checked_expected,
    checked_noise,
    link_named,
)
from nico_selfmodel.model.tree.body_tree import FREE, WORLD, WORLD_NAME, Attached, BodyTree
from nico_selfmodel.model.tree.standing_mirror import StandingMirror
from nico_selfmodel.names import shown

FORMAT = "nico-body/1"
BODY_FILE = "body.yaml"
"""Name of the file in a result folder."""
_RIGID = 1e-6
"""How far axes of a pose in a file may be from square and of unit length."""
_LIMITS = {"lower": -np.inf, "upper": np.inf}
"""Keys of a joint's limits, and what they are where they are not there."""


@dataclass(frozen=True, eq=False)
class BodyModel:
    """A body as it was learned."""

    name: str
    """Its name."""
    tree: BodyTree
    """Joints, markers, sensors."""
    si_per_unit: NDArray
    """Size of a reading's unit, with the wiring's sign [rad or m]. Shape (n,)."""
    covariance: ParameterCovariance | None = None
    """Of the parameters that were estimated."""
    noise: Mapping[str, float] = field(default_factory=dict)
    """Standard deviations of sensors and joints, by name [m, rad or px]."""
    expected: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    """Errors that new poses should show: `mm`, `px`, `touch` [m] -> `median` and `n`, of poses."""
    provenance: Mapping[str, Any] = field(default_factory=dict)
    """Where it came from."""
    limits: NDArray = field(default_factory=lambda: np.zeros((2, 0)))
    """Least and largest reading of each joint, in its own unit; infinite where it is not known, as
    all are if omitted. Shape (2, n)."""

    def __post_init__(self) -> None:
        """Take unknown limits for none."""
        n = len(self.tree.joints)
        limits = self.limits if np.size(self.limits) else [[-np.inf] * n, [np.inf] * n]
        object.__setattr__(self, "limits", read_only(limits, float))
        if np.shape(limits) != (2, n) or np.isnan(self.limits).any():
            raise ValueError(f"limits must be numbers of shape (2, {n}), got {np.shape(limits)}")

    @property
    def world(self) -> str:
        """Name of the frame in which places are told: what stood for the world in learning.

        A sensor that has a pose of its own by now, for it was moved and learned anew, lends it its
        name no more: the world stayed where it was.
        """
        name = str(self.provenance.get("world", WORLD_NAME))
        posed = [s.name for s in self.tree.sensors if np.any(np.eye(4) != s.X_LA)]
        return WORLD_NAME if name in posed else name

    @property
    def reach(self) -> NDArray:
        """Least and largest displacement of each joint [rad or m]. Shape (2, n)."""
        return np.sort(self.limits * self.si_per_unit / self.tree.gear, axis=0)

    def readings(self, readings: NDArray) -> NDArray:
        """Return readings in rad and m, zero where a joint has no encoder. Shape (N, n)."""
        return np.nan_to_num(np.asarray(readings, dtype=float) * self.si_per_unit)


def is_body(path: str | Path) -> bool:
    """Return whether a path is that of a body, or of a result folder with one."""
    path = Path(path)
    return (path / BODY_FILE).is_file() or path.name == BODY_FILE


def save_body(model: BodyModel, path: str | Path) -> None:
    """Write a body, whole or not at all."""
    write_whole(path, _body_text(model))


def _body_text(model: BodyModel) -> str:
    """Return a body as YAML; floats read back exactly."""
    tree = model.tree
    document: dict[str, Any] = {
        "format": FORMAT,
        "name": model.name,
        "joints": [_joint(model, i) for i in range(len(tree.joints))],
        "markers": [_attached(tree, a) | {"oriented": a.oriented} for a in tree.markers],
        "sensors": [
            _attached(tree, a)
            | ({"lens": _lens(tree.lenses[a.name])} if a.name in tree.lenses else {})
            for a in tree.sensors
        ],
        "noise": dict(model.noise),
        "expected": {unit: dict(found) for unit, found in model.expected.items()},
        "provenance": dict(model.provenance),
    }
    if tree.mirrors:
        document["mirrors"] = [_mirror(mirror) for mirror in tree.mirrors]
    if tree.planes:
        document["planes"] = [_attached(tree, plane) for plane in tree.planes]
    if tree.contacts:
        document["contacts"] = dict(tree.contacts)
    if tree.bending is not None:
        document["bending"] = bending_document(tree.bending)
    document["covariance"] = {} if model.covariance is None else model.covariance.document
    return yaml_text(document)


def load_body(path: str | Path) -> BodyModel:
    """Read a body.

    Args:
        path: The YAML file, or a result folder that holds `body.yaml`.

    Raises:
        ModelError: If the file is missing, of another format, or not valid.

    Warns:
        UserWarning: If it lies in the folder of a result that failed its checks.
    """
    path = Path(path)
    inside = path / BODY_FILE
    if not path.exists() or (path.is_dir() and not inside.exists()):
        raise ModelError(
            f"{found_at(path)}; a body is a result folder with {BODY_FILE}, or that file"
        )
    path = inside if path.is_dir() else path
    warn_of_failure(path)
    try:
        document = parse_yaml(read_text(path, LARGEST_BODY), str(path))
    except DataError as error:
        raise ModelError(f"{error}: a body was expected") from error
    found = document.get("format") if isinstance(document, dict) else None
    if found != FORMAT:
        raise ModelError(f"{path} is not a body: expected `format: {FORMAT}`, got {shown(found)}")
    try:
        return _model(document)
    except (AttributeError, KeyError, TypeError, ValueError) as error:
        raise ModelError(f"{path} is not a valid body: {damage(error)}") from error


def _joint(model: BodyModel, i: int) -> dict[str, Any]:
    tree = model.tree
    parent = int(tree.parent[i])
    entry: dict[str, Any] = {
        "name": tree.joints[i],
        "parent": tree.link_name(parent),
        "motion": tree.motions[i],
        "X_PJ": tree.X_PJ[i].tolist(),
        "gear": float(tree.gear[i]),
        "si_per_unit": float(model.si_per_unit[i]),
    }
    limits = zip(_LIMITS, model.limits[:, i].tolist(), strict=True)
    entry |= {key: value for key, value in limits if np.isfinite(value)}
    if tree.coupling[i, i] != 1.0:
        ratios = zip(tree.joints, tree.coupling[i].tolist(), strict=True)
        entry["follows"] = {name: ratio for name, ratio in ratios if ratio}
    return entry


def _attached(tree: BodyTree, item: Attached) -> dict[str, Any]:
    return {"name": item.name, "on": tree.link_name(item.on), "X_LA": item.X_LA.tolist()}


def _lens(camera: Camera) -> dict[str, Any]:
    kind = {} if camera.lens == POLYNOMIAL else {"lens": camera.lens}
    return kind | dict(camera.named_values) | {"image_size": list(camera.image_size)}


def _mirror(mirror: StandingMirror) -> dict[str, Any]:
    return {
        "name": mirror.name,
        "normal": mirror.plane.normal.tolist(),
        "distance": mirror.plane.offset,
        "tilts_from": mirror.facing.tolist(),
    }


def _read_mirror(entry: Mapping[str, Any]) -> StandingMirror:
    normal, facing = (np.asarray(numbers(entry[k], k)) for k in ("normal", "tilts_from"))
    return StandingMirror(entry["name"], Plane(normal, float(entry["distance"])), facing)


def _model(document: dict[str, Any]) -> BodyModel:
    joints = mappings(document["joints"], "joints")
    names = texts([joint["name"] for joint in joints], "joints")
    index = {name: i for i, name in enumerate(names)} | {WORLD_NAME: WORLD}
    coupling = np.eye(len(names))
    for i, joint in enumerate(joints):
        check_joint(joint)
        if "follows" in joint:
            coupling[i] = 0.0
            for lead, ratio in mapping(joint["follows"], "follows").items():
                coupling[i, index[lead]] = float(ratio)
    sensors = mappings(document["sensors"], "sensors")
    if any(joint["motion"] == FREE for joint in joints):
        raise ValueError("what moves freely is no part of a body")
    tree = BodyTree(
        tuple(names),
        tuple(texts([joint["motion"] for joint in joints], "motions")),
        np.array(
            [link_named(joint["parent"], index, f"joint {joint['name']}") for joint in joints],
            dtype=int,
        ),
        np.array([_pose(joint, "X_PJ") for joint in joints]).reshape(-1, 4, 4),
        np.array([float(joint["gear"]) for joint in joints]),
        coupling,
        tuple(_read_attached(entry, index) for entry in mappings(document["markers"], "markers")),
        tuple(_read_attached(entry, index) for entry in sensors),
        {entry["name"]: _read_lens(entry["lens"]) for entry in sensors if "lens" in entry},
        bending_of(mapping(document["bending"], "bending")) if "bending" in document else None,
        tuple(_read_mirror(entry) for entry in mappings(document.get("mirrors", []), "mirrors")),
        tuple(
            _read_attached(entry, index) for entry in mappings(document.get("planes", []), "planes")
        ),
        checked_contacts(document.get("contacts")),
    )
    known, covariance = last_mapping(document, "covariance"), None
    if known:
        check_parameters(texts(known["names"], "covariance"), tree.names)
        covariance = ParameterCovariance(
            tuple(texts(known["names"], "covariance")), numbers(known["matrix"], "covariance")
        )
    return BodyModel(
        document["name"],
        tree,
        np.array([float(joint["si_per_unit"]) for joint in joints]),
        covariance,
        checked_noise(document["noise"]),
        checked_expected(document.get("expected")),
        mapping(document["provenance"], "provenance"),
        np.array([[float(j.get(k, end)) for j in joints] for k, end in _LIMITS.items()]),
    )


def _read_attached(entry: Mapping[str, Any], index: Mapping[str, int]) -> Attached:
    return Attached(
        entry["name"],
        link_named(entry["on"], index, entry["name"]),
        _pose(entry, "X_LA"),
        bool(entry.get("oriented", True)),
    )


def _pose(entry: Mapping[str, Any], key: str) -> NDArray:
    """Return a pose of a body's file. Shape (4, 4)."""
    name = f"{key} of {entry['name']}"
    X = np.asarray(numbers(entry[key], name))
    if X.shape != (4, 4):
        raise ValueError(f"{name} must have shape (4, 4), got {X.shape}")
    check_rigid(X, name, _RIGID)
    return X


def _read_lens(entry: Mapping[str, Any]) -> Camera:
    kind = entry.get("lens", POLYNOMIAL)
    values = np.array([float(entry[name]) for name in intrinsics_of(kind)])
    width, height = entry["image_size"]
    return Camera.from_values(values, (int(width), int(height)), lens=kind)
