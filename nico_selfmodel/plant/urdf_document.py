"""URDF as XML that keeps comments, the order of attributes, and prefixes nobody declared."""

import re
from collections.abc import Callable, Iterator
from pathlib import Path
from xml.dom import expatbuilder
from xml.dom.minidom import Document, Element
from xml.parsers.expat import ExpatError, ParserCreate

import numpy as np
from numpy.typing import ArrayLike, NDArray

from nico_selfmodel.errors import DataError, ModelError
from nico_selfmodel.files.reading import LARGEST_ROBOT, read_bytes
from nico_selfmodel.geometry.rotation import rotation_from_rpy, rpy_of
from nico_selfmodel.geometry.transform import transform

SAME = 1e-14
"""Poses that differ by rounding only [m, and entries of the rotation]."""


JOINTS = ("joint", "drake:joint")
"""Elements that hang one link on another."""
_DEEPEST = 50
_PACKAGED = ("package://", "model://", "file://", "http://", "https://")
_COMMENT = re.compile(rb"<!--(.*?)-->", re.DOTALL)


def read_document(urdf: Path) -> Document:
    """Read a URDF as XML.

    Drake accepts prefixes that are not declared (`<drake:capsule>`), so namespaces are left alone,
    and hyphens in comments that XML forbids, so those are put apart.

    Raises:
        ModelError: If it is not XML, has no `<robot>`, or entities and nests that no robot needs.
    """
    try:
        content = _COMMENT.sub(_tamed_comment, read_bytes(urdf, LARGEST_ROBOT))
        _check_nesting(content)
        document = expatbuilder.parseString(content, namespaces=False)
    except DataError as error:
        raise ModelError(str(error)) from error
    except (ExpatError, LookupError, ValueError) as error:
        raise ModelError(f"{urdf} is not valid XML: {error}") from error
    if document.documentElement is None or document.documentElement.tagName != "robot":
        raise ModelError(f"{urdf} is not a URDF: its root element must be <robot>")
    return document


def _check_nesting(content: bytes) -> None:
    """Refuse entities, which may stand for gigabytes, and nests deeper than the stack.

    Raises:
        ValueError: Where there are some.
        ExpatError: If it is not XML.
    """
    depth = 0

    def start(*_: object) -> None:
        nonlocal depth
        depth += 1
        if depth > _DEEPEST:
            raise ValueError(f"elements are nested more than {_DEEPEST} deep")

    def end(*_: object) -> None:
        nonlocal depth
        depth -= 1

    def refuse(*_: object) -> None:
        raise ValueError("a robot has no document type and no entities (<!DOCTYPE ...>)")

    parser = ParserCreate()
    parser.StartElementHandler, parser.EndElementHandler = start, end
    parser.StartDoctypeDeclHandler = refuse
    parser.Parse(content, True)


def _tamed_comment(found: re.Match[bytes]) -> bytes:
    text = found[1]
    if b"--" in text or text.endswith(b"-"):
        text = text.replace(b"-", b"~")
    return b"<!--" + text + b"-->"


def robot_element(document: Document) -> Element:
    """Return the `<robot>` of a document that `read_document` accepted."""
    assert document.documentElement is not None
    return document.documentElement


def children(element: Element, *tags: str) -> Iterator[Element]:
    """Yield the direct children of the given kinds, in the order of the file."""
    for node in list(element.childNodes):
        if isinstance(node, Element) and node.tagName in tags:
            yield node


def child(element: Element, tag: str) -> Element | None:
    """Return the first direct child of a kind, or None."""
    return next(children(element, tag), None)


def linked(joint: Element, end: str) -> str:
    """Return the `parent` or `child` link of a joint; empty where the file names none."""
    element = child(joint, end)
    return "" if element is None else element.getAttribute("link")


def pose_of(element: Element | None) -> NDArray:
    """Return the pose that `xyz` and `rpy` of an element state. Shape (4, 4)."""
    if element is None:
        return np.eye(4)
    xyz, rpy = (_numbers(element.getAttribute(name)) for name in ("xyz", "rpy"))
    return transform(rotation_from_rpy(*rpy), xyz)


def set_pose(element: Element, pose: NDArray) -> None:
    """Write a pose as `xyz` and `rpy`, to the last bit; what says the same already stays.

    Args:
        element: An `<origin>` or `<frame>`.
        pose: Shape (4, 4).
    """
    if np.abs(pose_of(element) - pose).max() < SAME:
        return
    element.setAttribute("xyz", numbers_text(pose[:3, 3]))
    element.setAttribute("rpy", numbers_text(rpy_of(pose[:3, :3])))


def origin_of(element: Element) -> NDArray:
    """Return the pose in an element's `<origin>`, the identity if it has none. Shape (4, 4)."""
    return pose_of(child(element, "origin"))


def set_origin(element: Element, pose: NDArray) -> None:
    """Write a pose into an element's `<origin>`, which is made if need be. Shape (4, 4)."""
    origin = child(element, "origin")
    if origin is None:
        if np.abs(pose - np.eye(4)).max() < SAME:
            return
        origin = _new_element(element, "origin")
        element.insertBefore(origin, element.firstChild)
    set_pose(origin, pose)


def numbers_text(numbers: ArrayLike) -> str:
    """Write numbers so that they read back to the last bit."""
    return " ".join(repr(float(x) + 0.0) for x in np.ravel(np.asarray(numbers, dtype=float)))


def append(parent: Element, tag: str, **attributes: str) -> Element:
    """Add a child element after all others."""
    element = _new_element(parent, tag)
    for name, value in attributes.items():
        element.setAttribute(name, value)
    parent.appendChild(element)
    return element


def _new_element(beside: Element, tag: str) -> Element:
    document = beside.ownerDocument
    assert document is not None
    return document.createElement(tag)


def append_frame_link(robot: Element, name: str, parent: str, pose: NDArray) -> None:
    """Add a link without mass, fixed to another one.

    Args:
        robot: The `<robot>`.
        parent: The link it is fixed to.
        pose: Its pose in `parent`. Shape (4, 4).
    """
    append(robot, "link", name=name)
    joint = append(robot, "joint", name=f"{name}_mount", type="fixed")
    append(joint, "parent", link=parent)
    append(joint, "child", link=name)
    set_origin(joint, pose)


def lead_files(robot: Element, lead: Callable[[str], str]) -> None:
    """Rewrite relative paths of meshes and textures, which start at the URDF's own folder.

    Args:
        robot: The `<robot>`.
        lead: From a path in the file to the one that shall stand there.
    """
    for tag in ("mesh", "texture"):
        for element in robot.getElementsByTagName(tag):
            name = element.getAttribute("filename")
            if name and not Path(name).is_absolute() and not name.startswith(_PACKAGED):
                element.setAttribute("filename", lead(name))


def comment_text(text: str) -> str:
    """Return text that may stand in an XML comment, which must not hold two hyphens in a row."""
    return text.replace("-", "~") if "--" in text or text.endswith("-") else text


def document_text(document: Document) -> str:
    """Return the document as a file's content; elements that were added get their own lines."""
    robot = robot_element(document)
    for element in list(children(robot, "link", *JOINTS, "frame")):
        before = element.previousSibling
        if before is None or isinstance(before, Element):
            robot.insertBefore(document.createTextNode("\n  "), element)
    if isinstance(robot.lastChild, Element):
        robot.appendChild(document.createTextNode("\n"))
    nodes = [node.toxml() for node in document.childNodes]
    return "\n".join(['<?xml version="1.0"?>', *nodes]) + "\n"


def _numbers(text: str) -> NDArray:
    numbers = np.array(text.split(), dtype=float) if text.strip() else np.zeros(3)
    if numbers.shape != (3,):
        raise ModelError(f"expected three numbers in a URDF's origin, got {text!r}")
    return numbers


def hand_frame_name(marker: str) -> str:
    """Return the name of a tracked point's frame, in the plant and in an exported URDF."""
    return f"hand_{marker}"
