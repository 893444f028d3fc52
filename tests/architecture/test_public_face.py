"""The faces that users import from: every name is used in a document, and nothing else is."""

import ast
import importlib
import re
import subprocess
import sys
from pathlib import Path

import pytest

import nico_selfmodel

ROOT = Path(__file__).parents[2]
FACES = (
    "nico_selfmodel",
    "nico_selfmodel.systems",
    "nico_selfmodel.plant",
    "nico_selfmodel.servos",
)
EXAMPLES = sorted((ROOT / "examples").glob("*.py"))
DOCUMENTS = [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))]
HALF = "import time; t = time.process_time(); import nico_selfmodel; print(time.process_time() - t)"


def python_of(path):
    """Return the Python in a file: all of it, or what stands in a document's blocks."""
    text = path.read_text()
    return [text] if path.suffix == ".py" else re.findall(r"```python\n(.*?)```", text, re.DOTALL)


@pytest.mark.parametrize("face", FACES)
def test_every_name_that_is_offered_is_used_in_a_document(face):
    told = "\n".join(path.read_text() for path in [*EXAMPLES, *DOCUMENTS])
    names = importlib.import_module(face).__all__
    assert [name for name in names if not re.search(rf"\b{name}\b", told)] == []


@pytest.mark.parametrize("face", FACES)
def test_every_name_that_is_offered_is_there(face):
    package = importlib.import_module(face)
    assert all(getattr(package, name) is not None for name in package.__all__)
    assert set(package.__all__) <= set(dir(package))
    with pytest.raises(AttributeError, match="nothing_like_it"):
        _ = package.nothing_like_it


@pytest.mark.parametrize("path", [*EXAMPLES, *DOCUMENTS], ids=lambda path: path.name)
def test_documents_import_from_the_faces_alone(path):
    imported = {
        node.module
        for text in python_of(path)
        for node in ast.walk(ast.parse(text))
        if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("nico_selfmodel")
    }
    assert imported <= set(FACES)


def test_other_rooms_have_no_face():
    rooms = [
        path.parent.name for path in Path(nico_selfmodel.__file__).parent.glob("*/__init__.py")
    ]
    for room in set(rooms) - {face.rpartition(".")[2] for face in FACES}:
        text = (Path(nico_selfmodel.__file__).parent / room / "__init__.py").read_text()
        assert len(ast.parse(text).body) == 1, room


def test_importing_the_package_takes_less_than_a_twentieth_of_a_second():
    seconds = [
        float(subprocess.run([sys.executable, "-c", HALF], capture_output=True, text=True).stdout)
        for _ in range(5)
    ]
    assert min(seconds) < 0.05


def test_importing_the_package_loads_nothing_that_takes_long():
    loaded = "import sys, nico_selfmodel; print(*sys.modules)"
    names = subprocess.run([sys.executable, "-c", loaded], capture_output=True, text=True)
    assert "nico_selfmodel.lazy" in names.stdout.split()
    assert not {"typing", "re", "numpy"} & set(names.stdout.split())
