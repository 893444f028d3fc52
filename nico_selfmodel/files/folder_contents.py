"""What lies at a path, told to whoever took it for something else or trusts what failed."""

import warnings
from pathlib import Path

_KINDS = (
    ("body.yaml", "a result, of a body"),
    ("self_model.yaml", "a result, of an arm or cameras"),
    ("result.json", "a result"),
    ("poses.csv", "a recording of any body"),
    ("samples.csv", "a data set of an arm"),
)
"""A file that tells what a folder is, and what that is; the first one that is there counts."""
_HEAD = 64
"""Where a result states its verdict [bytes]: at its beginning."""
SUFFIXES = (".png", ".jpg", ".jpeg")
"""Of pictures."""


def found_at(path: Path) -> str:
    """Say what is at a path: `x is a result, of a body (body.yaml)`, `x does not exist`."""
    if not path.is_dir():
        return f"{path} is a file" if path.exists() else f"{path} does not exist"
    names = [inside.name for inside in path.iterdir()]
    if not names:
        return f"{path} is empty"
    for name, kind in _KINDS:
        if name in names:
            return f"{path} is {kind} ({name})"
    pictures = any(name.lower().endswith(SUFFIXES) for name in names)
    return f"{path} is a folder of {'pictures' if pictures else 'other files'}"


def warn_of_failure(model: Path) -> None:
    """Warn where a model lies in the folder of a result that failed its checks.

    Warns:
        UserWarning: If it does.
    """
    result = model.parent / "result.json"
    if not result.is_file():
        return
    with result.open("rb") as file:
        begins = file.read(_HEAD)
    if b'"status": "FAIL"' in begins:
        warnings.warn(
            f"{model.parent} failed its checks, as its result.json says: what its model tells is "
            "in doubt",
            stacklevel=3,
        )
