"""Self-models on disk: one YAML, `format: nico-selfmodel/1`."""

import re
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from nico_selfmodel.errors import ModelError
from nico_selfmodel.files import write_whole
from nico_selfmodel.model.dh_table import DhTable
from nico_selfmodel.model.self_model import ParameterCovariance, SelfModel
from nico_selfmodel.model.servo_map import ServoMap

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
    table, servos = model.dh, model.servos
    columns = np.stack([getattr(table, name) for name in _ROW], axis=1)
    document: dict[str, Any] = {
        "format": FORMAT,
        "name": model.name,
        "chain": {
            "X_W0": table.X_W0.tolist(),
            "rows": [
                {"joint": joint, **dict(zip(_ROW, row, strict=True))}
                for joint, row in zip(table.joints, columns.tolist(), strict=True)
            ],
            "hand": dict(zip(table.markers, table.p_NH.tolist(), strict=True)),
        },
        "servos": [
            {
                "joint": joint,
                "offset": float(servos.offset[i]),
                "gear": float(servos.gear[i]),
                "sign": int(servos.sign[i]),
                "unit": servos.unit[i],
                **(
                    {"counts_per_turn": float(servos.counts_per_turn[i])}
                    if servos.unit[i] == "counts"
                    else {}
                ),
            }
            for i, joint in enumerate(servos.joints)
        ],
        "cameras": {},
        "mirrors": {},
        "noise_sigma_m": model.noise_sigma,
        "robot": dict(model.robot),
        "fit": dict(model.fit),
        "provenance": dict(model.provenance),
    }
    if model.covariance is not None:
        matrix = model.covariance.matrix.tolist()
        document["covariance"] = {"names": list(model.covariance.names), "matrix": matrix}
    return document


def _model(document: dict[str, Any]) -> SelfModel:
    chain, servos = document["chain"], document["servos"]
    rows, hands = chain["rows"], chain["hand"]
    joints = tuple(row["joint"] for row in rows)
    table = DhTable(
        joints,
        np.array(chain["X_W0"], dtype=float),
        **{name: np.array([row[name] for row in rows], dtype=float) for name in _ROW},
        markers=tuple(hands),
        p_NH=np.array(list(hands.values()), dtype=float),
    )
    _check_rotation(table.X_W0)
    servo_map = ServoMap(
        tuple(servo["joint"] for servo in servos),
        offset=np.array([servo["offset"] for servo in servos]),
        gear=np.array([servo["gear"] for servo in servos]),
        unit=tuple(servo["unit"] for servo in servos),
        counts_per_turn=np.array([servo.get("counts_per_turn", np.nan) for servo in servos]),
        sign=np.array([servo.get("sign", 1) for servo in servos]),
    )
    known = document.get("covariance")
    return SelfModel(
        document["name"],
        table,
        servo_map,
        ParameterCovariance(tuple(known["names"]), known["matrix"]) if known else None,
        document.get("noise_sigma_m"),
        document.get("robot", {}),
        document.get("fit", {}),
        document.get("provenance", {}),
    )


def _check_rotation(x: np.ndarray) -> None:
    r = x[:3, :3]
    orthonormal = np.abs(r @ r.T - np.eye(3)).max() <= 1e-9 and np.linalg.det(r) > 0.0
    if not (orthonormal and np.array_equal(x[3], [0.0, 0.0, 0.0, 1.0])):
        raise ValueError("chain.X_W0 is not a rigid transform")


def _one_line(error: Exception) -> str:
    return " ".join(str(error).split())


_NUMBER = re.compile(r"^[-+]?(?:\d[\d_]*)(?:\.\d*)?[eE][-+]?\d+$")


class _Loader(yaml.SafeLoader):
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
