"""What lies at a path, told to whoever took it for something else."""

from pathlib import Path

_KINDS = (
    ("body.yaml", "a result, of a body"),
    ("self_model.yaml", "a result, of an arm or cameras"),
    ("result.json", "a result"),
    ("poses.csv", "a recording of any body"),
    ("samples.csv", "a data set of an arm"),
)
"""A file that tells what a folder is, and what that is; the first one that is there counts."""
_PICTURES = (".png", ".jpg", ".jpeg")


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
    pictures = any(name.lower().endswith(_PICTURES) for name in names)
    return f"{path} is a folder of {'pictures' if pictures else 'other files'}"
