"""Names that options and folders give, checked before any work is done."""

from pathlib import Path
from typing import Annotated

import typer

from nico_selfmodel.files.reading import real_path
from nico_selfmodel.names import LONGEST_NAME, check_name


def checked_name(name: str | None) -> str | None:
    """Return the value of `--name`.

    Raises:
        ValueError: If it is no name.
    """
    if name is not None:
        check_name(name, "--name")
    return name


def name_after(path: Path) -> str:
    """Return what something is called that has no name of its own: what its folder is called.

    Raises:
        ValueError: If that is no name.
    """
    name = real_path(path).name[:LONGEST_NAME].strip()
    check_name(name, f"the name of {path}, by which it would be called,")
    return name


ModelName = Annotated[
    str | None, typer.Option("--name", help="Name of the self-model.", callback=checked_name)
]
DatasetName = Annotated[
    str | None, typer.Option("--name", help="Name of the data set.", callback=checked_name)
]
