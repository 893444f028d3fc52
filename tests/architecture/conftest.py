"""The source files of the package, parsed once."""

import ast
import gc
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import pytest


@dataclass(frozen=True, eq=False)
class SourceFile:
    """One Python file of the package."""

    path: Path  # relative to the package
    text: str
    tree: ast.Module

    @property
    def room(self) -> str:
        """The folder or file right under the package; `__init__` for the package itself."""
        return self.path.parts[0].removesuffix(".py")

    @cached_property
    def nodes(self) -> list[ast.AST]:
        """Whatever stands in the file."""
        return list(ast.walk(self.tree))

    def functions(self) -> Iterator[ast.FunctionDef | ast.AsyncFunctionDef]:
        """Yield every function and method."""
        for node in self.nodes:
            if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
                yield node


@pytest.fixture(scope="session")
def sources(project_root: Path) -> list[SourceFile]:
    package = project_root / "nico_selfmodel"
    paths = sorted(package.rglob("*.py"))
    assert len(paths) > 10, f"only {len(paths)} source files under {package}"
    # Nothing that is parsed is ever let go: to look through it takes most of the time.
    gc.disable()
    texts = [path.read_text(encoding="utf-8") for path in paths]
    files = [
        SourceFile(path.relative_to(package), text, ast.parse(text))
        for path, text in zip(paths, texts, strict=True)
    ]
    assert all(file.nodes for file in files)
    gc.freeze()
    gc.enable()
    return files
