"""Which room imports what: the finer half of the import contracts in pyproject.toml.

import-linter sees `pydrake` as one package; here each part of Drake has its room.
"""

import ast
import sys
import tomllib
from functools import cache
from graphlib import CycleError, TopologicalSorter

# What a room may import besides the standard library and the floors below it.
ALLOWED = {
    "__init__": set(),
    "__main__": set(),
    "errors": set(),
    "arrays": {"numpy"},
    "blas_threads": {"numpy", "threadpoolctl"},
    "freed_memory": set(),
    "loading": set(),
    "parallel": {"distributed"},
    "progress": set(),
    "least_squares": {"numpy"},
    "lazy": set(),
    "files": {"yaml"},
    "names": set(),
    "with_blocks": set(),
    "geometry": {"numpy"},
    "model": {"numpy"},
    "dataset": {"numpy", "yaml"},
    "optimization": {
        "numpy",
        "pydrake.autodiffutils",
        "pydrake.common",
        "pydrake.solvers",
        "pydrake.symbolic",
    },
    "estimation": {"numpy"},
    "plant": {
        "numpy",
        "pydrake.autodiffutils",
        "pydrake.common",
        "pydrake.geometry",
        "pydrake.math",
        "pydrake.multibody",
        "pydrake.symbolic",
        "pydrake.systems.framework",
    },
    "vision": {"cv2", "numpy"},
    "servos": {"dynamixel_sdk", "numpy", "scservo_sdk", "serial"},
    "systems": {
        "numpy",
        "pydrake.autodiffutils",
        "pydrake.common",
        "pydrake.geometry",
        "pydrake.math",
        "pydrake.multibody",
        "pydrake.systems",
    },
    "viz": {
        "jinja2",
        "matplotlib",
        "meshcat",
        "numpy",
        "pydrake.common",
        "pydrake.geometry",
        "pydrake.math",
        "pydrake.perception",
    },
    "recording": {"numpy"},
    "result_folder": set(),
    "planning": {"numpy"},
    "sessions": {"numpy"},
    "experiments": {"numpy", "pydrake.common", "yaml"},
    "cli": {"numpy", "rich", "typer"},
}


@cache
def imported_modules(tree):
    """Return (line, dotted module) of every absolute import, wherever in the file it stands."""
    found = []
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            found += [(node.lineno, alias.name) for alias in node.names]
        elif isinstance(node, ast.ImportFrom) and node.level == 0:
            if node.module == "pydrake":  # from pydrake import geometry
                found += [(node.lineno, f"pydrake.{alias.name}") for alias in node.names]
            else:
                found.append((node.lineno, node.module))
    return found


def foreign_imports(tree, room):
    """Return the imports of third-party modules that the room may not use."""
    ours = sys.stdlib_module_names | {"nico_selfmodel"}
    return [
        (line, module)
        for line, module in imported_modules(tree)
        if module.split(".")[0] not in ours
        and not any(module == name or module.startswith(name + ".") for name in ALLOWED[room])
    ]


def test_the_check_itself_tells_one_part_of_drake_from_another():
    tree = ast.parse(
        "import os, numpy.linalg\n"
        "from pydrake.multibody.plant import MultibodyPlant\n"
        "from pydrake import solvers\n"
        "def draw():\n"
        "    from pydrake.all import Meshcat\n"
    )
    assert foreign_imports(tree, "plant") == [(3, "pydrake.solvers"), (5, "pydrake.all")]
    assert foreign_imports(tree, "geometry")[0] == (2, "pydrake.multibody.plant")


def test_each_room_imports_only_what_its_floor_allows(sources):
    offences = [
        f"{source.path}:{line} imports {module}"
        for source in sources
        for line, module in foreign_imports(source.tree, source.room)
    ]
    assert offences == []


def test_the_table_names_the_rooms_of_the_import_contracts(project_root):
    config = tomllib.loads((project_root / "pyproject.toml").read_text(encoding="utf-8"))
    contracts = config["tool"]["importlinter"]["contracts"]
    (floors,) = [contract for contract in contracts if contract["id"] == "floors"]
    rooms = {room.strip(" ()") for floor in floors["layers"] for room in floor.split("|")}
    assert rooms == set(ALLOWED) - {"__init__"}


def test_no_room_hides_an_import_from_the_contracts(sources):
    hidden = [
        f"{source.path}:{node.lineno}"
        for source in sources
        if source.path.name != "lazy.py"  # what it loads, the faces import for type checkers
        for node in source.nodes
        if (isinstance(node, ast.Attribute) and node.attr == "import_module")
        or (isinstance(node, ast.Name) and node.id in {"import_module", "__import__"})
    ]
    assert hidden == []


def circle_of(trees):
    """Return files that import each other in a circle, for types alone too; empty if none do.

    Args:
        trees: Parsed files by their dotted names.
    """
    graph = {
        name: {module for _, module in imported_modules(tree) if module in trees}
        for name, tree in trees.items()
    }
    try:
        TopologicalSorter(graph).prepare()
    except CycleError as error:
        return list(error.args[1])
    return []


def test_the_check_of_circles_sees_imports_for_types():
    load = ast.parse("if TYPE_CHECKING:\n    from a.motion import Motion")
    motion = ast.parse("from a.load import Load")
    assert set(circle_of({"a.load": load, "a.motion": motion})) == {"a.load", "a.motion"}
    assert circle_of({"a.load": ast.parse("import numpy"), "a.motion": motion}) == []


def test_no_files_import_each_other_in_a_circle(sources):
    trees = {
        ".".join(("nico_selfmodel", *source.path.with_suffix("").parts)): source.tree
        for source in sources
        if source.path.name != "__init__.py"
    }
    assert circle_of(trees) == []
