"""The source files of the package, parsed once."""

import ast
from collections.abc import Iterator
from dataclasses import dataclass
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

    def functions(self) -> Iterator[ast.FunctionDef | ast.AsyncFunctionDef]:
        """Yield every function and method."""
        for node in ast.walk(self.tree):
            if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
                yield node


@pytest.fixture(scope="session")
def sources(project_root: Path) -> list[SourceFile]:
    package = project_root / "nico_selfmodel"
    paths = sorted(package.rglob("*.py"))
    assert len(paths) > 10, f"only {len(paths)} source files under {package}"
    texts = [path.read_text(encoding="utf-8") for path in paths]
    return [
        SourceFile(path.relative_to(package), text, ast.parse(text))
        for path, text in zip(paths, texts, strict=True)
    ]
