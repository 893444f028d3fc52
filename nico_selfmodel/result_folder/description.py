"""The robot's description in a result folder, so that a folder that is sent away still works."""

import shutil
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from nico_selfmodel.files.reading import real_path
from nico_selfmodel.plant.robots import ROBOTS

if TYPE_CHECKING:
    from xml.dom.minidom import Element

    from nico_selfmodel.plant import ArmDescription

FOLDER = "robot"
"""Folder within the result folder: the robot's URDF, and the files it names by a path."""
_MESHES = "meshes"
_COMPANIONS = (".mtl", ".bin")
"""Ends of files beside a mesh, of the same name, without which it is not whole."""


def kept_description(robot: "ArmDescription | None", folder: Path) -> "ArmDescription | None":
    """Copy a robot's URDF and its meshes into a folder; return the description that lies there.

    A robot that this package ships is found by its name everywhere, and stays where it is. So do
    meshes that are named by a package, and what a path leads to that is not there.

    Args:
        robot: The robot that an arm belongs to; None where there is none.

    Raises:
        ModelError: If the URDF is gone.
        OSError: If something cannot be copied.
    """
    if robot is None or robot.robot in ROBOTS:
        return robot
    from nico_selfmodel.plant.urdf_document import document_text, read_document, robot_element

    document = read_document(robot.urdf)
    inside = folder / FOLDER
    inside.mkdir()
    copied = _Copies(robot.urdf.parent, inside)
    for tag in ("mesh", "texture"):
        for element in robot_element(document).getElementsByTagName(tag):
            copied.take(element)
    urdf = inside / robot.urdf.name
    if copied.names:
        urdf.write_text(document_text(document), encoding="utf-8", newline="\n")
    else:
        shutil.copyfile(robot.urdf, urdf)
    return replace(robot, urdf=urdf, robot=str(real_path(urdf)))


class _Copies:
    """Files that a URDF names, beside its copy; two of one name are told apart by a number."""

    def __init__(self, original: Path, inside: Path) -> None:
        self.original, self.inside = original, inside
        self.names: dict[Path, str] = {}

    def take(self, element: "Element") -> None:
        """Copy the file that an element names, and let it name the copy."""
        name = element.getAttribute("filename")
        path = self.original / name
        if not name or "://" in name or not path.is_file():
            return
        if path not in self.names:
            self.names[path] = self._copy(path)
        element.setAttribute("filename", f"{_MESHES}/{self.names[path]}")

    def _copy(self, path: Path) -> str:
        (self.inside / _MESHES).mkdir(exist_ok=True)
        stem, taken = path.stem, set(self.names.values())
        while f"{stem}{path.suffix}" in taken:
            stem = f"{path.stem}_{len(taken)}"
        for end in (path.suffix, *_COMPANIONS):
            if path.with_suffix(end).is_file():
                # An OBJ names its .mtl itself, so that a companion keeps its name.
                name = f"{stem}{end}" if end == path.suffix else path.with_suffix(end).name
                shutil.copyfile(path.with_suffix(end), self.inside / _MESHES / name)
        return f"{stem}{path.suffix}"
