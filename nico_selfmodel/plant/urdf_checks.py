"""What a URDF must be before Drake sees it, which ends the process over some of what is wrong.

Numbers, names, and what hangs on what. What only Drake knows (its own tags, meshes) stays with it.
"""

import math
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from xml.dom.minidom import Document, Element

from nico_selfmodel.errors import ModelError
from nico_selfmodel.names import check_name, listed, shown
from nico_selfmodel.plant.urdf_document import JOINTS, child, children, linked, robot_element

WORLD = "world"
_LARGEST = 1e9
_THREE, _ONE = 3, 1
_NUMBERS: dict[str, dict[str, int]] = {
    "origin": {"xyz": _THREE, "rpy": _THREE},
    "frame": {"xyz": _THREE, "rpy": _THREE},
    "axis": {"xyz": _THREE},
    "limit": dict.fromkeys(("lower", "upper", "effort", "velocity", "drake:acceleration"), _ONE),
    "dynamics": dict.fromkeys(("damping", "friction"), _ONE),
    "mimic": dict.fromkeys(("multiplier", "offset"), _ONE),
    "mass": {"value": _ONE},
    "inertia": dict.fromkeys(("ixx", "iyy", "izz", "ixy", "ixz", "iyz"), _ONE),
    "box": {"size": _THREE},
    "sphere": {"radius": _ONE},
    "cylinder": {"radius": _ONE, "length": _ONE},
    "capsule": {"radius": _ONE, "length": _ONE},
    "drake:capsule": {"radius": _ONE, "length": _ONE},
    "drake:ellipsoid": dict.fromkeys("abc", _ONE),
}
"""Element -> attribute -> how many numbers it holds."""
_POSITIVE = ("box", "sphere", "cylinder", "capsule", "drake:capsule", "drake:ellipsoid")
_NOT_NEGATIVE = {"mass", "dynamics"}
_MOVING = ("revolute", "continuous", "prismatic", "planar")
_PARTS = ("link", *JOINTS, "frame")


def check_urdf(document: Document, urdf: Path) -> None:
    """Refuse a robot that no robot is.

    Args:
        document: What `read_document` returned.
        urdf: The file, for the message.

    Raises:
        ModelError: If a number is none, or of a size or sign that it cannot have; a name is
            missing, not printable or given twice; a link is not there, hangs on two joints, or
            on itself.
    """
    robot = robot_element(document)
    links = [link.getAttribute("name") for link in children(robot, "link")]
    joints = list(children(robot, *JOINTS))
    for what, names in (("link", links), ("joint", [j.getAttribute("name") for j in joints])):
        _check_names(what, names, urdf)
    for part in children(robot, *_PARTS):
        where = f"{urdf}: {part.tagName} {part.getAttribute('name')!r}"
        for element in _inside(part):
            _check_numbers(element, where)
    for joint in children(robot, "joint"):
        _check_joint(joint, links, [j.getAttribute("name") for j in joints], urdf)
    _check_tree(joints, urdf)


def _check_names(what: str, names: list[str], urdf: Path) -> None:
    for name in names:
        if not name:
            raise ModelError(f"{urdf}: a {what} has no name")
        try:
            check_name(name, f"the name of a {what}")
        except ValueError as error:
            raise ModelError(f"{urdf}: {error}") from None
    twice = [name for name, count in Counter(names).items() if count > 1]
    if twice:
        raise ModelError(f"{urdf}: {what} {twice[0]!r} is there twice")


def _inside(element: Element) -> Iterator[Element]:
    """Yield an element and all that stand in it."""
    todo = [element]
    while todo:
        here = todo.pop()
        yield here
        todo += [node for node in here.childNodes if isinstance(node, Element)]


def _check_numbers(element: Element, where: str) -> None:
    tag = element.tagName
    for name, count in _NUMBERS.get(tag, {}).items():
        if not element.hasAttribute(name):
            continue
        text = element.getAttribute(name)
        values = _values(text, f"{where}, {tag} {name}")
        if len(values) != count:
            raise ModelError(
                f"{where}, {tag} {name}: {count} number{'s' * (count > 1)} expected, got "
                f"{shown(text)}"
            )
        if tag in _POSITIVE and min(values) <= 0.0:
            raise ModelError(f"{where}, {tag} {name}: must be positive, got {shown(text)}")
        if tag in _NOT_NEGATIVE and min(values) < 0.0:
            raise ModelError(f"{where}, {tag} {name}: must not be negative, got {shown(text)}")


def _values(text: str, where: str) -> list[float]:
    values = []
    for word in text.split():
        try:
            value = float(word)
        except ValueError:
            raise ModelError(f"{where}: {shown(word)} is not a number") from None
        if not math.isfinite(value):
            raise ModelError(f"{where}: {word} is not finite; leave out what has no limit")
        if abs(value) > _LARGEST:
            raise ModelError(f"{where}: {value:g} is larger than anything of a robot")
        values.append(value)
    return values


def _check_joint(joint: Element, links: list[str], joints: list[str], urdf: Path) -> None:
    where = f"{urdf}: joint {joint.getAttribute('name')!r}"
    if not joint.getAttribute("type"):
        raise ModelError(f"{where} has no type")
    for end in ("parent", "child"):
        link = linked(joint, end)
        if not link:
            raise ModelError(f"{where} names no {end} link")
        if link not in links and link != WORLD:
            raise ModelError(
                f"{where}: its {end} {shown(link)} is not there; links are {listed(links, link)}"
            )
    if linked(joint, "parent") == linked(joint, "child"):
        raise ModelError(f"{where} hangs {linked(joint, 'child')!r} on itself")
    axis, limit, mimic = (child(joint, tag) for tag in ("axis", "limit", "mimic"))
    kind = joint.getAttribute("type")
    # What cannot move may have any axis and limits: some programs write zeros there.
    turns = kind in _MOVING and axis is not None and axis.hasAttribute("xyz")
    if turns and axis is not None and not any(_values(axis.getAttribute("xyz"), where)):
        raise ModelError(f"{where}: its axis is zero")
    if kind in _MOVING and limit is not None:
        _check_limit(limit, where, bounded=kind != "continuous")
    if mimic is not None and mimic.getAttribute("joint") not in joints:
        raise ModelError(
            f"{where} mimics {shown(mimic.getAttribute('joint'))}, which is not there; joints are "
            f"{listed(joints)}"
        )


def _check_limit(limit: Element, where: str, *, bounded: bool) -> None:
    names = ("lower", "upper", "velocity", "drake:acceleration")
    given = {name: float(limit.getAttribute(name) or "nan") for name in names}
    if bounded and given["lower"] > given["upper"]:
        raise ModelError(
            f"{where}: its lower limit {given['lower']:g} lies above its upper one "
            f"{given['upper']:g}"
        )
    for name in ("velocity", "drake:acceleration"):
        if given[name] < 0.0:
            raise ModelError(f"{where}: its {name} must not be negative, got {given[name]:g}")


def _check_tree(joints: list[Element], urdf: Path) -> None:
    """Refuse links that hang on two joints, or in the end on themselves."""
    above: dict[str, str] = {}
    for joint in joints:
        link = linked(joint, "child")
        if link in above or link == WORLD:
            raise ModelError(f"{urdf}: link {link!r} is the child of two joints, or is the world")
        above[link] = linked(joint, "parent")
    settled: set[str] = set()
    for link in above:
        way: dict[str, None] = {}
        while link in above and link not in settled:
            if link in way:
                ring = list(way)[list(way).index(link) :]
                raise ModelError(f"{urdf}: the links {listed(ring)} hang on each other in a ring")
            way[link] = None
            link = above[link]
        settled.update(way)
