"""Self-models on disk: one YAML, `format: nico-selfmodel/1`."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from nico_selfmodel.errors import DataError, ModelError
from nico_selfmodel.files.folder_contents import found_at, warn_of_failure
from nico_selfmodel.files.reading import LARGEST_DOCUMENT, read_text, real_path
from nico_selfmodel.files.whole import write_whole
from nico_selfmodel.files.yaml_text import parse_yaml, yaml_text
from nico_selfmodel.geometry.transform import check_rigid
from nico_selfmodel.model import kept_values
from nico_selfmodel.model.arm.bending_document import bending_document, bending_of
from nico_selfmodel.model.arm.dh_table import DhTable
from nico_selfmodel.model.arm.servo_map import ServoMap
from nico_selfmodel.model.cameras.camera import Camera
from nico_selfmodel.model.cameras.mirror import Mirror
from nico_selfmodel.model.cameras.projection import POLYNOMIAL, intrinsics_of
from nico_selfmodel.model.document_values import (
    LARGEST_SIGMA_M,
    LARGEST_SIGMA_PX,
    damage,
    last_mapping,
    mapping,
    mappings,
    number,
    numbers,
    sigma,
    texts,
)
from nico_selfmodel.model.encoder_units import COUNTS
from nico_selfmodel.model.self_model import ParameterCovariance, SelfModel
from nico_selfmodel.names import shown

FORMAT = "nico-selfmodel/1"
LARGEST_VARIANCE = 1e24
"""Of a parameter, in its own units squared."""
LARGEST_SIDE = 100_000
"""Of an image [px]."""
_HERE = "./"
"""Begins the path of a robot description that lies beside the self-model."""
_ROW = ("D", "theta_zero", "r", "alpha", "beta")


def save_model(model: SelfModel, path: str | Path) -> None:
    """Write a self-model, whole or not at all.

    A robot description that lies beside the file, or in a folder there, is named by the way to it
    (`./robot/arm.urdf`), so that both can be moved together.

    Raises:
        OSError: If the folder cannot be written to.
        yaml.YAMLError: If what is kept for people is not plain data.
    """
    robot = _led_from(model.robot, real_path(path).parent)
    write_whole(path, yaml_text(_document(model) | {"robot": robot}))


def load_model(path: str | Path) -> SelfModel:
    """Read a self-model.

    Args:
        path: The YAML file, or a result folder that holds `self_model.yaml`.

    Returns:
        The model, equal to the last bit to the one saved.

    Raises:
        ModelError: If the file is missing, of another format or version, or not valid.

    Warns:
        UserWarning: If it lies in the folder of a result that failed its checks.
    """
    path = Path(path)
    inside = path / "self_model.yaml"
    if not path.exists() or (path.is_dir() and not inside.exists()):
        raise ModelError(
            f"{found_at(path)}; the self-model of an arm or of cameras is a result folder "
            "with self_model.yaml, or that file"
        )
    path = inside if path.is_dir() else path
    warn_of_failure(path)
    try:
        document = parse_yaml(read_text(path, LARGEST_DOCUMENT), str(path))
    except DataError as error:
        raise ModelError(f"{error}: a self-model was expected") from error
    _check_format(document, path)
    try:
        return _model(document, path)
    except (AttributeError, KeyError, TypeError, ValueError) as error:
        raise ModelError(f"{path} is not a valid self-model: {damage(error)}") from error


def _check_format(document: Any, path: Path) -> None:
    found = document.get("format") if isinstance(document, dict) else None
    if found == FORMAT:
        return
    if isinstance(found, str) and found.startswith("nico-selfmodel/"):
        raise ModelError(f"{path} has format {found}, this version reads {FORMAT}: learn it anew")
    raise ModelError(f"{path} is not a self-model: expected `format: {FORMAT}`, got {shown(found)}")


def _document(model: SelfModel) -> dict[str, Any]:
    document: dict[str, Any] = {"format": FORMAT, "name": model.name}
    if model.has_arm:
        document["chain"] = _chain_document(model.dh)
        document["servos"] = [_servo_document(model.servos, i) for i in range(len(model.joints))]
    if model.bending is not None:
        document["bending"] = bending_document(model.bending)
    document |= {
        "cameras": {side: _camera_document(camera) for side, camera in model.cameras.items()},
        "mirrors": {name: _mirror_document(mirror) for name, mirror in model.mirrors.items()},
        "noise_sigma_m": model.noise_sigma,
        "pixel_sigma_px": model.pixel_sigma,
        "robot": {},
        "fit": dict(model.fit),
        "provenance": dict(model.provenance),
        "covariance": {} if model.covariance is None else model.covariance.document,
    }
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
        **(turn if servos.unit[i] == COUNTS else {}),
    }


def _camera_document(camera: Camera) -> dict[str, Any]:
    size = list(camera.image_size)
    kind = {} if camera.lens == POLYNOMIAL else {"lens": camera.lens}
    return {"image_size": size, **kind, **camera.named_values, "X_WC": camera.X_WC.tolist()}


def _mirror_document(mirror: Mirror) -> dict[str, Any]:
    known = {} if mirror.covariance is None else {"covariance": mirror.covariance.tolist()}
    return {"normal": mirror.normal.tolist(), "distance": mirror.distance, **known}


def _led_from(robot: Mapping[str, Any], folder: Path) -> dict[str, Any]:
    """Name a description in a folder by the way that leads there from it."""
    found = dict(robot)
    urdf = Path(found.get("urdf", ""))
    if urdf.is_absolute() and urdf.is_relative_to(folder):
        found["urdf"] = _HERE + urdf.relative_to(folder).as_posix()
    return found


def _model(document: dict[str, Any], path: Path) -> SelfModel:
    known, robot = last_mapping(document, "covariance"), kept_values.robot(document.get("robot"))
    if robot and robot["urdf"].startswith(_HERE):
        robot["urdf"] = str(real_path(path).parent / robot["urdf"])
    arm = "chain" in document or "servos" in document
    cameras, mirrors = (mapping(document.get(part), part) for part in ("cameras", "mirrors"))
    return SelfModel(
        document["name"],
        _chain(mapping(document["chain"], "chain")) if arm else None,
        _servo_map(mappings(document["servos"], "servos")) if arm else None,
        _covariance(known) if known else None,
        sigma(document.get("noise_sigma_m"), "noise_sigma_m", LARGEST_SIGMA_M),
        robot,
        kept_values.fit(document.get("fit"), len(document["servos"]) if arm else 0),
        kept_values.provenance(document.get("provenance")),
        {side: _camera(mapping(entry, side), side) for side, entry in cameras.items()},
        sigma(document.get("pixel_sigma_px"), "pixel_sigma_px", LARGEST_SIGMA_PX),
        {name: _mirror(mapping(entry, name), name) for name, entry in mirrors.items()},
        bending_of(mapping(document["bending"], "bending")) if "bending" in document else None,
    )


def _covariance(known: Mapping[str, Any]) -> ParameterCovariance:
    names = texts(known["names"], "covariance.names")
    matrix = numbers(known["matrix"], "covariance.matrix", LARGEST_VARIANCE)
    return ParameterCovariance(names, matrix)


def _chain(chain: Mapping[str, Any]) -> DhTable:
    rows, hands = mappings(chain["rows"], "chain.rows"), mapping(chain["hand"], "chain.hand")
    columns = {name: [row[name] for row in rows] for name in _ROW}
    table = DhTable(
        texts([row["joint"] for row in rows], "joints of the rows"),
        numbers(chain["X_W0"], "chain.X_W0"),
        **{name: numbers(column, f"{name} of the rows") for name, column in columns.items()},
        markers=tuple(hands),
        p_NH=numbers(list(hands.values()), "chain.hand"),
    )
    check_rigid(table.X_W0, "chain.X_W0")
    return table


def _servo_map(servos: Sequence[Mapping[str, Any]]) -> ServoMap:
    unit = texts([servo["unit"] for servo in servos], "units of the servos")
    counts = [
        servo["counts_per_turn"] if own == COUNTS else 1.0
        for servo, own in zip(servos, unit, strict=True)
    ]
    counts_per_turn = numbers(counts, "counts_per_turn")
    return ServoMap(
        texts([servo["joint"] for servo in servos], "joints of the servos"),
        offset=numbers([servo["offset"] for servo in servos], "offset"),
        gear=numbers([servo["gear"] for servo in servos], "gear"),
        unit=unit,
        counts_per_turn=np.where(np.array(unit) == COUNTS, counts_per_turn, np.nan),
        sign=numbers([servo.get("sign", 1) for servo in servos], "sign"),
    )


def _camera(entry: Mapping[str, Any], side: str) -> Camera:
    size = entry["image_size"]
    if numbers(size, f"image_size of {side}", LARGEST_SIDE).shape != (2,):
        raise ValueError(f"image_size of {side} must be two numbers, got {shown(size)}")
    width, height = size
    lens = str(entry.get("lens", POLYNOMIAL))
    values = numbers([entry[name] for name in intrinsics_of(lens)], f"intrinsics of {side}")
    pose = numbers(entry["X_WC"], f"X_WC of {side}")
    camera = Camera.from_values(values, (width, height), pose, lens)
    check_rigid(camera.X_WC, "a camera's X_WC")
    return camera


def _mirror(entry: Mapping[str, Any], name: str) -> Mirror:
    known = entry.get("covariance")
    return Mirror(
        numbers(entry["normal"], f"normal of {name}"),
        number(entry["distance"], f"distance of {name}"),
        None if known is None else numbers(known, f"covariance of {name}", LARGEST_VARIANCE),
    )
