"""Groups of bodies that do not collide with each other: `add_collision_filter_group`.

Drake (1.51) takes groups only of what was parsed in the same call, which a self-model is not.
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

from pydrake.geometry import CollisionFilterDeclaration, GeometrySet
from pydrake.multibody.parsing import AddCollisionFilterGroup, GetScopedFrameByName, Parser
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import RigidBody

from nico_selfmodel.errors import ModelError
from nico_selfmodel.names import listed


@dataclass(frozen=True)
class CollisionGroup:
    """Bodies and other groups, by their full names."""

    name: str
    """Its own."""
    bodies: tuple[str, ...]
    """`instance::body` each."""
    groups: tuple[str, ...]
    """Groups whose bodies are in it, too."""
    ignored: tuple[str, ...]
    """Groups with which its bodies do not collide; itself, if it is among them."""
    where: str
    """Its place in a file, for messages."""

    @classmethod
    def of(cls, told: AddCollisionFilterGroup, where: str) -> "CollisionGroup":
        """Take what a directive says; all its names are in its namespace."""
        scope = f"{told.model_namespace}::" if told.model_namespace else ""
        bodies, groups, ignored = (
            tuple(f"{scope}{name}" for name in names)
            for names in (told.members, told.member_groups, told.ignored_collision_filter_groups)
        )
        return cls(f"{scope}{told.name}", bodies, groups, ignored, where)


def filter_collisions(groups: Iterable[CollisionGroup], parser: Parser) -> None:
    """Let no two bodies collide that groups set apart; nothing happens without a scene graph.

    Args:
        groups: In any order.
        parser: Of the plant that has their bodies.

    Raises:
        ModelError: If a body or a group is not there, or a name is given twice.
    """
    plant, known = parser.plant(), dict[str, CollisionGroup]()
    for group in groups:
        if group.name in known:
            raise ModelError(f"{group.where}: there is a group {group.name!r} already")
        known[group.name] = group
    found = {name: _bodies(plant, known, name, group.where) for name, group in known.items()}
    if parser.scene_graph() is None:
        return
    manager = parser.scene_graph().collision_filter_manager()
    sets = {name: plant.CollectRegisteredGeometries(bodies) for name, bodies in found.items()}
    for group in known.values():
        for other in group.ignored:
            _check_known(other, known, group.where)
            manager.Apply(_apart(sets[group.name], sets[other], alike=other == group.name))


def _apart(one: GeometrySet, other: GeometrySet, *, alike: bool) -> CollisionFilterDeclaration:
    declaration = CollisionFilterDeclaration()
    return declaration.ExcludeWithin(one) if alike else declaration.ExcludeBetween(one, other)


def _bodies(
    plant: MultibodyPlant, known: Mapping[str, CollisionGroup], name: str, where: str
) -> list[RigidBody]:
    """Return the bodies of a group, and of all groups that it takes in."""
    todo, taken, bodies = [name], set[str](), []
    while todo:
        group = _check_known(todo.pop(), known, where)
        if group.name in taken:
            continue
        taken.add(group.name)
        bodies += [_body(plant, member, group.where) for member in group.bodies]
        todo += group.groups
    return bodies


def _check_known(name: str, known: Mapping[str, CollisionGroup], where: str) -> CollisionGroup:
    if name not in known:
        raise ModelError(f"{where}: no group {name!r}; there are {listed(known, name)}")
    return known[name]


def _body(plant: MultibodyPlant, name: str, where: str) -> RigidBody:
    try:
        frame = GetScopedFrameByName(plant, name)
    except RuntimeError as error:
        raise ModelError(f"{where}: {' '.join(str(error).split())}") from error
    if not frame.is_body_frame():
        raise ModelError(f"{where}: {name!r} is a frame: give the body that carries it")
    return frame.body()
