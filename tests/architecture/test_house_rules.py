"""What every file of the project keeps to, whatever room it is in."""

import ast
import re
import subprocess
from collections import Counter

import pytest

LONGEST_FILE = 400
LONGEST_FUNCTION = 60  # with its docstring
ROOMS_FOR_ANYTHING = {"base", "common", "core", "helper", "helpers", "manager", "util", "utils"}

PICTURES = {".jpg", ".png"}
CALLED_FROM_OUTSIDE = {
    *("clearPort", "writePort", "readPort", "getBaudRate"),  # by the SDKs of servos, of a port
    *("_update_ticks", "get_majorticklabels"),  # by matplotlib, of an axis
    "is_closed",  # by users, of a station
}

# A path that only one machine has, or the address of a package registry.
MACHINE_PATH = re.compile(r"(?<![\w.$}~])/(?:home|root|Users|work|tmp/env)/\w")
REGISTRY_HOST = re.compile(
    r"\b(?:pypi\.org|pythonhosted\.org|registry\.npmjs\.org|npmjs\.com|(?:deb|ftp)\.debian\.org)"
)


def public_definitions(tree):
    """Yield (line, name) of what is public and must be documented, the module first."""
    yield tree, "the module"
    stack = [tree]
    while stack:
        for node in stack.pop().body:
            is_class = isinstance(node, ast.ClassDef)
            if not is_class and not isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
                continue
            if node.name.startswith("_"):
                continue
            yield node, node.name
            if is_class:
                stack.append(node)


def body_length(function):
    """Return the number of lines below signature and docstring."""
    body = function.body[1:] if ast.get_docstring(function) else function.body
    return function.end_lineno - body[0].lineno + 1 if body else 0


def test_no_file_is_too_long_to_read(sources):
    lengths = {str(source.path): len(source.text.splitlines()) for source in sources}
    assert {path: n for path, n in lengths.items() if n > LONGEST_FILE} == {}


def test_no_function_is_too_long_to_read(sources):
    lengths = {
        f"{source.path}:{function.name}": body_length(function)
        for source in sources
        for function in source.functions()
    }
    assert {name: n for name, n in lengths.items() if n > LONGEST_FUNCTION} == {}


def test_no_room_is_too_full_to_overlook(sources):
    rooms = Counter(s.path.parent for s in sources if s.path.parent.name != "cli")
    assert {str(room): count for room, count in rooms.items() if count > 20} == {}


def test_the_house_speaks_the_words_of_the_field(sources):
    private = re.compile(r"\b(believed?|sightings?|blind|eyes?|wild|lessons?|outsiders?)\b")
    # An identity matrix, readers, a key of files, Nico's joints, and the field's own words.
    known = re.compile(
        r'np\.eye|colour-blind|"eyes"|\("neck", "eye"\)|(?i:hand-eye)|eye-(?:in|to)-hand'
    )
    found = {str(s.path): private.findall(known.sub("", s.text)) for s in sources}
    assert {path: words for path, words in found.items() if words} == {}


def test_no_room_is_named_after_nothing(sources):
    names = {part.removesuffix(".py") for source in sources for part in source.path.parts}
    assert names & ROOMS_FOR_ANYTHING == set()


def test_everything_public_is_documented(sources):
    undocumented = [
        f"{source.path}: {name}"
        for source in sources
        for node, name in public_definitions(source.tree)
        if not ast.get_docstring(node)
    ]
    assert undocumented == []


def test_everything_that_is_defined_is_used_in_the_house_or_shown_in_a_document(
    sources, project_root
):
    """What only tests reach is dead, but for what simulations are asked and told by tests."""
    shown = [*project_root.glob("docs/*.*"), *project_root.glob("examples/*.py")]
    shown += [project_root / "README.md", *project_root.glob("nico_selfmodel/**/*.j2")]
    texts = [path.read_text(encoding="utf-8") for path in shown if path.suffix not in PICTURES]
    texts += [source.text for source in sources]
    words = Counter(re.findall(r"\w+", "\n".join(texts)))
    built = [source for source in sources if "simulated" not in source.path.parts]
    nodes = [
        (source.path, node)
        for source in built
        for node in source.nodes
        if isinstance(node, ast.FunctionDef | ast.ClassDef)
    ]
    classes = {node.name for _, node in nodes if isinstance(node, ast.ClassDef)}
    called = {
        method.name  # by the library whose class it completes
        for _, node in nodes
        if isinstance(node, ast.ClassDef) and {ast.unparse(base) for base in node.bases} - classes
        for method in node.body
        if isinstance(method, ast.FunctionDef)
    }
    alone = {
        f"{path}: {node.name}"
        for path, node in nodes
        if words[node.name] < 2 and not node.name.startswith("__")
        if node.name not in called | CALLED_FROM_OUTSIDE
    }
    assert alone == set()


def test_annotations_are_not_postponed(sources):
    # Drake's yaml_load_typed cannot read a dataclass whose annotations are text.
    postponed = [
        str(source.path)
        for source in sources
        for node in source.nodes
        if isinstance(node, ast.ImportFrom) and node.module == "__future__"
    ]
    assert postponed == []


def test_one_module_reads_yaml_and_one_reads_json(sources):
    readers = {
        call: {str(source.path) for source in sources if call in source.text}
        for call in ("yaml.load", "json.loads(")
    }
    assert readers["yaml.load"] == {"files/yaml_text.py"}
    # Lines that come over a socket are short, and read by those who know what they may be.
    sockets = {path for path in readers["json.loads("] if path.startswith(("servos/", "systems/"))}
    assert readers["json.loads("] - sockets == {"files/json_text.py"}


@pytest.fixture(scope="module")
def project_texts(project_root):
    """Return path -> text of every text file that git knows or would add."""
    if not (project_root / ".git").exists():
        pytest.skip("not a git checkout: nothing says which files belong to the project")
    listed = subprocess.run(
        ["git", "ls-files", "-z", "--cached", "--others", "--exclude-standard"],
        cwd=project_root,
        check=True,
        capture_output=True,
        encoding="utf-8",
    ).stdout
    texts = {}
    for name in filter(None, listed.split("\0")):
        path = project_root / name
        content = path.read_bytes() if path.is_file() else b"\0"
        if b"\0" not in content:
            texts[name] = content.decode("utf-8")
    assert "pyproject.toml" in texts
    return texts


@pytest.mark.parametrize("pattern", [MACHINE_PATH, REGISTRY_HOST], ids=["path", "registry"])
def test_no_file_depends_on_one_machine(project_texts, pattern):
    offences = [
        f"{name}:{number}: {line.strip()[:80]}"
        for name, text in project_texts.items()
        for number, line in enumerate(text.splitlines(), start=1)
        if pattern.search(line)
    ]
    assert offences == []


def test_the_patterns_know_a_machine_path_and_a_registry():
    someone = "/".join(["", "home", "someone", "data"])
    assert MACHINE_PATH.search(f'open("{someone}")')
    assert not MACHINE_PATH.search("see docs/work/plan or ~/root/x")
    assert REGISTRY_HOST.search(".".join(["https://pypi", "org/simple"]))


@pytest.mark.parametrize("marker", ["first command", "main command", "test command"])
def test_the_readme_has_one_block_for_each_command(project_root, marker):
    text = (project_root / "README.md").read_text(encoding="utf-8")
    blocks = re.findall(rf"^<!-- {marker} -->\n```sh\n(.+?)\n```$", text, re.MULTILINE | re.DOTALL)
    assert len(blocks) == 1
    assert blocks[0].startswith("python3 -m venv .venv")
