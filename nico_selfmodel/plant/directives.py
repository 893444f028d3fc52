"""Drake's model directives with one more: a robot that moves as a self-model has it.

```yaml
directives:
- add_model: {name: table, file: table.urdf}
- add_weld: {parent: world, child: table::top}
- add_self_model: {name: arm, model: first_arm, frame: table::top}
- add_weld: {parent: arm::tool0, child: gripper::base}
```
"""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from pydrake.math import RigidTransform
from pydrake.multibody.parsing import (
    GetScopedFrameByName,
    LoadModelDirectivesFromString,
    Parser,
    ProcessModelDirectives,
)
from pydrake.multibody.plant import MultibodyPlant

from nico_selfmodel.errors import DataError, ModelError
from nico_selfmodel.files.reading import LARGEST_DOCUMENT, read_text, real_path
from nico_selfmodel.files.yaml_mapping import check_keys, text_value
from nico_selfmodel.files.yaml_text import parse_yaml, yaml_items
from nico_selfmodel.model.document_values import mapping
from nico_selfmodel.model.self_model import SelfModel
from nico_selfmodel.model.self_model_file import load_model
from nico_selfmodel.model.tree.body_model import BODY_FILE, load_body
from nico_selfmodel.names import listed
from nico_selfmodel.plant.body_plant import BodyPlant
from nico_selfmodel.plant.collision_groups import CollisionGroup, filter_collisions
from nico_selfmodel.plant.description import ArmDescription
from nico_selfmodel.plant.self_model_plant import SelfModelPlant

Learned = SelfModelPlant | BodyPlant
OWN = "add_self_model"
_KEYS = ("name", "model", "robot", "frame", "default_joint_positions")
_ROBOT_KEYS = ("urdf", "base_link", "tip_link", "held", "points")


def add_directives(path: str | Path, parser: Parser) -> dict[str, Learned]:
    """Add what a file of model directives names to a plant, self-models among it.

    `add_self_model` has `name` (of the model instance) and `model` (a result folder, or the
    `self_model.yaml` or `body.yaml` in one); where a self-model names no robot, or another one is
    meant, `robot` with the arguments of `ArmDescription.from_urdf`; `frame` (`instance::frame`)
    that is the measuring frame, the world if omitted; and `default_joint_positions` (joint -> rad
    or m). It stands in this file, not in one that `add_directives` of it names. All else is
    Drake's. Paths, those of `file` too, start at the folder of the file.

    Args:
        parser: Of a plant that is not finalized, with the packages that the file needs.

    Returns:
        What was learned, by name.

    Raises:
        ModelError: If the plant is finalized, a name is not known, or a model does not fit its
            robot; the message tells the file and the directive.
    """
    path = Path(path)
    plant = parser.plant()
    if plant.is_finalized():
        raise ModelError(f"{path}: the plant is finalized already: add models before Finalize()")
    robots: dict[str, Learned] = {}
    groups: list[CollisionGroup] = []

    def lead(key: str, value: str) -> str:
        if key == "file" and "://" not in value:
            return real_path(path.parent / value).as_uri()
        return value

    try:
        items = yaml_items(read_text(path, LARGEST_DOCUMENT), str(path), "directives", lead)
    except DataError as error:
        raise ModelError(str(error)) from error
    for number, item in enumerate(items, 1):
        where = f"{path}, directive {number}"
        try:
            if item.startswith((f"{OWN}:", f"{{{OWN}:")):
                entry = parse_yaml(item, where)[OWN]
                name, robot = _add_self_model(plant, path.parent, entry, f"{where}, {OWN}")
                robots[name] = robot
            else:
                groups += _process(item, parser, where)
        except DataError as error:
            raise ModelError(str(error)) from error
        except (RuntimeError, ValueError) as error:
            reason = " ".join(str(error).split()).removeprefix("error: ")
            if f"key '{OWN}'" in reason:  # Drake reads files that others name
                reason = f"{OWN} in a file that another one names: put it into {path} itself"
            raise ModelError(f"{where}: {reason}") from error
    filter_collisions(groups, parser)
    return robots


def _process(item: str, parser: Parser, where: str) -> list[CollisionGroup]:
    """Let Drake add what one directive of its own names; return a group of what is there then."""
    lines = item.replace("\n", "\n  ")
    loaded = LoadModelDirectivesFromString(f"directives:\n- {lines}")
    group, weld = loaded.directives[0].add_collision_filter_group, loaded.directives[0].add_weld
    if group is not None:
        return [CollisionGroup.of(group, where)]
    if weld is None:
        ProcessModelDirectives(loaded, parser)
        return []
    # Drake (1.51) ends the process over a weld whose child is not of the same call.
    plant = parser.plant()
    parent, child = (GetScopedFrameByName(plant, name) for name in (weld.parent, weld.child))
    X_PC = RigidTransform() if weld.X_PC is None else weld.X_PC.GetDeterministicValue()
    plant.WeldFrames(parent, child, X_PC)
    return []


def _add_self_model(
    plant: MultibodyPlant, folder: Path, entry: Any, where: str
) -> tuple[str, Learned]:
    if not isinstance(entry, dict):
        raise DataError(f"{where}: expected a mapping with {', '.join(_KEYS)}")
    check_keys(entry, _KEYS, where)
    name = text_value(entry, "name", where)
    path = folder / text_value(entry, "model", where)
    if (path / BODY_FILE).is_file() and not (path / "self_model.yaml").is_file():
        path = path / BODY_FILE
    frame = None
    if entry.get("frame") is not None:
        frame = GetScopedFrameByName(plant, text_value(entry, "frame", where))
    try:
        if path.name == BODY_FILE:
            robot = BodyPlant.add_to(plant, load_body(path), name=name, frame=frame)
        else:
            model = load_model(path)
            arm = _arm(model, folder, entry.get("robot"), where)
            robot = SelfModelPlant.add_to(plant, arm, model, name=name, frame=frame)
    except ModelError as error:
        raise ModelError(f"{where}: {error}") from error
    _set_defaults(robot, entry.get("default_joint_positions"), where)
    return name, robot


def _arm(model: SelfModel, folder: Path, robot: Any, where: str) -> ArmDescription:
    if robot is None:
        arm = ArmDescription.of_model(model)
        if arm is None:
            raise ModelError(f"self-model {model.name!r} names no robot: give robot with its urdf")
        return arm
    if not isinstance(robot, dict):
        raise DataError(f"{where}, robot: expected a mapping with {', '.join(_ROBOT_KEYS)}")
    check_keys(robot, _ROBOT_KEYS, f"{where}, robot")
    where = f"{where}, robot"
    urdf = text_value(robot, "urdf", where)
    links = [text_value(robot, key, where, "") or None for key in ("base_link", "tip_link")]
    held, points = (mapping(robot.get(key), f"{where}, {key}") for key in ("held", "points"))
    beside = folder / urdf
    return ArmDescription.from_urdf(beside if beside.is_file() else urdf, *links, held, points)


def _set_defaults(robot: Learned, positions: Any, where: str) -> None:
    if positions is None:
        return
    where = f"{where}, default_joint_positions"
    if not isinstance(positions, Mapping):
        raise DataError(f"{where}: expected a mapping of joints to positions")
    plant, instance = robot.plant, robot.instance
    joints = [plant.get_joint(index) for index in plant.GetJointIndices(instance)]
    names = [joint.name() for joint in joints if joint.num_positions()]
    for name, value in positions.items():
        if name not in names:
            raise DataError(f"{where}: no joint {name!r}; there are {listed(names, str(name))}")
        joint = plant.GetJointByName(name, instance)
        values = np.atleast_1d(np.asarray(value, dtype=float))
        if values.shape != (joint.num_positions(),):
            raise DataError(f"{where}: {name} needs {joint.num_positions()} numbers, got {value}")
        joint.set_default_positions(values)
