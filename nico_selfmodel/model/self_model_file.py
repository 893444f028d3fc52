"""Self-models on disk: one YAML, `format: nico-selfmodel/1`."""

import re
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from nico_selfmodel.errors import ModelError
from nico_selfmodel.files import write_whole
from nico_selfmodel.model.camera import INTRINSICS, Camera
from nico_selfmodel.model.dh_table import DhTable
from nico_selfmodel.model.mirror import Mirror
from nico_selfmodel.model.self_model import ParameterCovariance, SelfModel
from nico_selfmodel.model.servo_map import ServoMap
from nico_selfmodel.unique_keys import UniqueKeys

FORMAT = "nico-selfmodel/1"
_ROW = ("D", "theta_zero", "r", "alpha", "beta")


def save_self_model(model: SelfModel, path: str | Path) -> None:
    """Write a self-model, whole or not at all.

    Raises:
        OSError: If the folder cannot be written to.
    """
    text = yaml.dump(_document(model), Dumper=_FlowDumper, sort_keys=False, width=100)
    write_whole(path, text)


def load_self_model(path: str | Path) -> SelfModel:
    """Read a self-model.

    Args:
        path: The YAML file, or a result folder that holds `self_model.yaml`.

    Returns:
        The model, equal to the last bit to the one saved.

    Raises:
        ModelError: If the file is missing, of another format or version, or not valid.
    """
    path = Path(path)
    path = path / "self_model.yaml" if path.is_dir() else path
    try:
        document = yaml.load(path.read_text(encoding="utf-8"), Loader=_Loader)
    except FileNotFoundError as error:
        raise ModelError(f"{path} does not exist: give a self_model.yaml") from error
    except (OSError, UnicodeDecodeError, yaml.YAMLError) as error:
        raise ModelError(f"{path} cannot be read as YAML: {_one_line(error)}") from error
    _check_format(document, path)
    try:
        return _model(document)
    except (AttributeError, KeyError, TypeError, ValueError) as error:
        reason = f"{error} is missing" if isinstance(error, KeyError) else _one_line(error)
        raise ModelError(f"{path} is not a valid self-model: {reason}") from error


def _check_format(document: Any, path: Path) -> None:
    found = document.get("format") if isinstance(document, dict) else None
    if found == FORMAT:
        return
    if isinstance(found, str) and found.startswith("nico-selfmodel/"):
        raise ModelError(f"{path} has format {found}, this version reads {FORMAT}: learn it anew")
    raise ModelError(f"{path} is not a self-model: expected `format: {FORMAT}`, got {found!r}")


def _document(model: SelfModel) -> dict[str, Any]:
    document: dict[str, Any] = {"format": FORMAT, "name": model.name}
    if model.has_arm:
        document["chain"] = _chain_document(model.dh)
        document["servos"] = [_servo_document(model.servos, i) for i in range(len(model.joints))]
    document |= {
        "cameras": {eye: _camera_document(camera) for eye, camera in model.cameras.items()},
        "mirrors": {name: _mirror_document(mirror) for name, mirror in model.mirrors.items()},
        "noise_sigma_m": model.noise_sigma,
        "pixel_sigma_px": model.pixel_sigma,
        "robot": dict(model.robot),
        "fit": dict(model.fit),
        "provenance": dict(model.provenance),
    }
    if model.covariance is not None:
        matrix = model.covariance.matrix.tolist()
        document["covariance"] = {"names": list(model.covariance.names), "matrix": matrix}
    return document


def _chain_document(table: DhTable) -> dict[str, Any]:
    columns = np.stack([getattr(table, name) for name in _ROW], axis=1)
    return {
        "X_W0": table.X_W0.tolist(),
        "rows": [
            {"joint": joint, **dict(zip(_ROW, row, strict=True))}
            for joint, row in zip(table.joints, columns.tolist(), strict=True)
        ],
        "hand": dict(zip(table.markers, table.p_NH.tolist(), strict=True)),
    }


def _servo_document(servos: ServoMap, i: int) -> dict[str, Any]:
    turn = {"counts_per_turn": float(servos.counts_per_turn[i])}
    return {
        "joint": servos.joints[i],
        "offset": float(servos.offset[i]),
        "gear": float(servos.gear[i]),
        "sign": int(servos.sign[i]),
        "unit": servos.unit[i],
        **(turn if servos.unit[i] == "counts" else {}),
    }


def _camera_document(camera: Camera) -> dict[str, Any]:
    size = list(camera.image_size)
    return {"image_size": size, **camera.named_values, "X_WC": camera.X_WC.tolist()}


def _mirror_document(mirror: Mirror) -> dict[str, Any]:
    known = {} if mirror.covariance is None else {"covariance": mirror.covariance.tolist()}
    return {"normal": mirror.normal.tolist(), "distance": mirror.distance, **known}


def _model(document: dict[str, Any]) -> SelfModel:
    known = document.get("covariance")
    arm = "chain" in document or "servos" in document
    return SelfModel(
        document["name"],
        _chain(document["chain"]) if arm else None,
        _servo_map(document["servos"]) if arm else None,
        ParameterCovariance(tuple(known["names"]), known["matrix"]) if known else None,
        document.get("noise_sigma_m"),
        document.get("robot", {}),
        document.get("fit", {}),
        document.get("provenance", {}),
        {eye: _camera(entry) for eye, entry in (document.get("cameras") or {}).items()},
        document.get("pixel_sigma_px"),
        {name: _mirror(entry) for name, entry in (document.get("mirrors") or {}).items()},
    )


def _chain(chain: dict[str, Any]) -> DhTable:
    rows, hands = chain["rows"], chain["hand"]
    table = DhTable(
        tuple(row["joint"] for row in rows),
        np.array(chain["X_W0"], dtype=float),
        **{name: np.array([row[name] for row in rows], dtype=float) for name in _ROW},
        markers=tuple(hands),
        p_NH=np.array(list(hands.values()), dtype=float),
    )
    _check_rigid(table.X_W0, "chain.X_W0")
    return table


def _servo_map(servos: list[dict[str, Any]]) -> ServoMap:
    return ServoMap(
        tuple(servo["joint"] for servo in servos),
        offset=np.array([servo["offset"] for servo in servos]),
        gear=np.array([servo["gear"] for servo in servos]),
        unit=tuple(servo["unit"] for servo in servos),
        counts_per_turn=np.array([servo.get("counts_per_turn", np.nan) for servo in servos]),
        sign=np.array([servo.get("sign", 1) for servo in servos]),
    )


def _camera(entry: dict[str, Any]) -> Camera:
    width, height = entry["image_size"]
    values = [entry[name] for name in INTRINSICS]
    camera = Camera.from_values(values, (width, height), entry["X_WC"])
    _check_rigid(camera.X_WC, "a camera's X_WC")
    return camera


def _mirror(entry: dict[str, Any]) -> Mirror:
    return Mirror(np.array(entry["normal"], float), entry["distance"], entry.get("covariance"))


def _check_rigid(x: np.ndarray, name: str) -> None:
    r = x[:3, :3]
    orthonormal = np.abs(r @ r.T - np.eye(3)).max() <= 1e-9 and np.linalg.det(r) > 0.0
    if not (orthonormal and np.array_equal(x[3], [0.0, 0.0, 0.0, 1.0])):
        raise ValueError(f"{name} is not a rigid transform")


def _one_line(error: Exception) -> str:
    return " ".join(str(error).split())


_NUMBER = re.compile(r"^[-+]?(?:\d[\d_]*)(?:\.\d*)?[eE][-+]?\d+$")


class _Loader(UniqueKeys, yaml.SafeLoader):
    """Safe loading that also reads `1e-3`, which YAML 1.1 takes for text."""


_Loader.add_implicit_resolver(
    "tag:yaml.org,2002:float",
    _NUMBER,
    list("-+0123456789"),
)


class _FlowDumper(yaml.SafeDumper):
    """Block style for mappings, one line for lists of numbers."""


def _represent_text(dumper: yaml.SafeDumper, value: str) -> yaml.Node:
    """Quote what this reader would take for a number."""
    style = "'" if _NUMBER.match(value) else None
    return dumper.represent_scalar("tag:yaml.org,2002:str", value, style=style)


_FlowDumper.add_representer(str, _represent_text)


def _represent_list(dumper: yaml.SafeDumper, value: list[Any]) -> yaml.Node:
    flat = all(isinstance(item, (int, float, str)) for item in value)
    return dumper.represent_sequence("tag:yaml.org,2002:seq", value, flow_style=flat)


_FlowDumper.add_representer(list, _represent_list)
