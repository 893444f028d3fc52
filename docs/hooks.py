"""Pages of the site that are made when it is built: documents of the project, tutorials, reference.

A tutorial is an example with what it printed when the site was built; an example that fails ends
the build. The reference holds each name that the package and its faces offer, from its docstring.
"""

import ast
import os
import re
import subprocess
import sys
import tempfile
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

from mkdocs.config.defaults import MkDocsConfig
from mkdocs.exceptions import PluginError
from mkdocs.structure.files import File, Files

ROOT = Path(__file__).resolve().parents[1]
PAGES = {
    "README.md": "index.md",
    "CONVENTIONS.md": "conventions.md",
    "CONTRIBUTING.md": "contributing.md",
    "CHANGELOG.md": "changelog.md",
    "examples/data/README.md": "data.md",
}
"""Documents of the project -> pages of the site."""
NEED_ORIGINALS = ("03_", "04_")
"""Examples that import measurements which are not in the box as they were."""
NEED_A_MODEL = ("14_",)
"""Examples that look at a result; they draw it once."""
COMMAND = "from nico_selfmodel.cli.main import main; main()"
LONGEST_S = 300.0
FACES = (
    "nico_selfmodel",
    "nico_selfmodel.plant",
    "nico_selfmodel.systems",
    "nico_selfmodel.servos",
)
"""Modules whose names people use."""


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Add the pages that lie elsewhere or are made."""
    examples = sorted((ROOT / "examples").glob("[0-9]*.py"))
    made = {page: _moved(ROOT / source, page) for source, page in PAGES.items()}
    with ThreadPoolExecutor(2) as pool:
        tutorials = dict(zip(map(_tutorial, examples), pool.map(_page_of, examples), strict=True))
    rows = "".join(f"| [{_title(path)}]({path.stem}.md) | {_says(path)} |\n" for path in examples)
    tutorials["tutorials/index.md"] = f"# Tutorials\n\n| example | |\n|---|---|\n{rows}"
    reference = {f"reference/{_leaf(face)}.md": _reference(face) for face in FACES}
    links = "".join(f"* [{face}]({_leaf(face)}.md)\n" for face in FACES)
    reference["reference/index.md"] = f"# Reference\n\n{links}"
    for page, text in {**made, **tutorials, **reference}.items():
        files.append(File.generated(config, page, content=text))
    return files


def on_config(config: MkDocsConfig) -> MkDocsConfig:
    """List the pages that are made."""
    examples = sorted((ROOT / "examples").glob("[0-9]*.py"))
    tutorials: list[Any] = ["tutorials/index.md"]
    tutorials += [{_title(path): _tutorial(path)} for path in examples]
    reference: list[Any] = ["reference/index.md"]
    reference += [{face: f"reference/{_leaf(face)}.md"} for face in FACES]
    made = {"tutorials/": tutorials, "reference/": reference}
    nav = config.nav or []
    for entry in nav:
        for title, target in list(entry.items()) if isinstance(entry, dict) else []:
            if isinstance(target, str) and target in made:
                entry[title] = made[target]
    return config


def on_page_markdown(markdown: str, page: Any, **_: Any) -> str:
    """Let links of a document that lead out of the site's pages lead to where they are."""
    source = Path("docs") / page.file.src_uri
    return markdown if page.file.generated_by else _with_links(markdown, source, page.file.src_uri)


def _moved(path: Path, page: str) -> str:
    return _with_links(path.read_text(encoding="utf-8"), path.relative_to(ROOT), page)


def _with_links(text: str, source: Path, page: str) -> str:
    """Rewrite relative links of a document so that they hold on its page; others become names."""

    def link(found: re.Match[str]) -> str:
        words, target, anchor = found[1], found[2], found[3] or ""
        if "://" in target or not target:
            return found[0]
        path = Path(os.path.normpath(source.parent / target))
        there = _page_of_file(path)
        if there is None:
            if not (ROOT / path).exists():
                raise PluginError(f"{source}: a link to {target}, which is not there")
            return f"{words} (`{path}`)" if words != str(path) else f"`{path}`"
        return f"[{words}]({os.path.relpath(there, Path(page).parent)}{anchor})"

    return re.sub(r"\[([^\]]*)\]\(([^)#\s]*)(#[^)\s]*)?\)", link, text)


def _page_of_file(path: Path) -> str | None:
    """Return the page of a document, an example or a picture; None where it has none."""
    if str(path) in PAGES:
        return PAGES[str(path)]
    if path.parts[0] == "examples" and path.suffix == ".py":
        return _tutorial(path)
    if path == Path("examples"):
        return "tutorials/index.md"
    if path == Path("examples/data"):
        return "data.md"
    return str(Path(*path.parts[1:])) if path.parts[0] == "docs" else None


def _tutorial(path: Path) -> str:
    return f"tutorials/{path.stem}.md"


def _title(path: Path) -> str:
    words = path.stem.partition("_")[2].replace("_", " ")
    return words[0].upper() + words[1:]


def _says(path: Path) -> str:
    docstring = ast.get_docstring(ast.parse(path.read_text(encoding="utf-8"))) or ""
    return docstring.partition("\n")[0]


def _page_of(path: Path) -> str:
    """Return an example with what it prints."""
    text = path.read_text(encoding="utf-8")
    page = f"# {_title(path)}\n\n`examples/{path.name}`\n\n```python\n{text}```\n"
    if path.name.startswith(NEED_ORIGINALS):
        return page
    if not path.name.startswith(NEED_A_MODEL):
        return f"{page}\nIt prints\n\n```text\n{_run(path)}```\n"
    with tempfile.TemporaryDirectory() as folder:
        model, words = (
            f"{folder}/first_arm",
            ("learn", "--sensor", "motion-capture", "--random", "20"),
        )
        _run("-c", COMMAND, *words, "--out", model)
        return f"{page}\nIt prints\n\n```text\n{_run(path, model, '--once')}```\n"


def _run(*words: str | Path) -> str:
    """Run an example, or a command, as a person would; return what it prints.

    Raises:
        PluginError: If it fails.
    """
    places = os.pathsep.join([str(ROOT), os.environ.get("PYTHONPATH", "")])
    with tempfile.TemporaryDirectory() as folder:  # what an example writes is not the project's
        done = subprocess.run(
            [sys.executable, *map(str, words)],
            capture_output=True,
            text=True,
            timeout=LONGEST_S,
            env={**os.environ, "PYTHONPATH": places, "OMP_NUM_THREADS": "1"},
            cwd=folder,
            check=False,
        )
    if done.returncode != 0:
        raise PluginError(f"{words} failed: {done.stderr[-2000:]}")
    return done.stdout


def _leaf(face: str) -> str:
    return face.rpartition(".")[2]


def _reference(face: str) -> str:
    """Return a page with each name that a module offers, by where its docstring stands."""
    file = ROOT / Path(*face.split(".")) / "__init__.py"
    tree = ast.parse(file.read_text(encoding="utf-8"))
    homes = {
        name.asname or name.name: f"{node.module}.{name.name}"
        for node in ast.walk(tree)
        if isinstance(node, ast.ImportFrom) and node.module
        for name in node.names
    }
    offered = next(
        ast.literal_eval(node.value)
        for node in tree.body
        if isinstance(node, ast.Assign) and getattr(node.targets[0], "id", "") == "__all__"
    )
    blocks = [f"::: {homes[name]}\n" for name in offered if name in homes]
    return f"# {face}\n\n{ast.get_docstring(tree) or ''}\n\n" + "\n".join(blocks)
