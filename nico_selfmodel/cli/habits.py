"""Options that every command has: how much it says, and a file that gives it options."""

from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import Annotated, Any

import typer

from nico_selfmodel.cli import printer
from nico_selfmodel.names import listed


def add_habits(command: Any) -> None:
    """Give a command, and all below it, the options `--options`, `--verbose` and `--quiet`.

    Args:
        command: The root of the tree of commands; its types have no public name.
    """
    for leaf in _leaves(command):
        leaf.params += [p for p in _habits().params if p.name != "help"]


def _leaves(command: Any) -> Iterator[Any]:
    below = getattr(command, "commands", None)
    if below is None:
        yield command
        return
    for one in below.values():
        yield from _leaves(one)


@cache
def _habits() -> Any:
    """Return a command that has nothing but these options, none of which reaches a function."""
    app = typer.Typer(add_completion=False)
    app.command()(_declared)
    found = typer.main.get_command(app)
    for param in found.params:
        param.expose_value = False
    return found


def _take_options(context: typer.Context, path: Path | None) -> None:
    """Let a file give what the command line does not.

    Raises:
        ValueError: If it names an option that the command does not have.
    """
    if path is None:
        return
    from nico_selfmodel.files.reading import LARGEST_DOCUMENT, read_text
    from nico_selfmodel.files.yaml_text import parse_yaml

    found = parse_yaml(read_text(path, LARGEST_DOCUMENT), str(path))
    if not isinstance(found, dict):
        raise ValueError(f"{path}: expected options as `name: value`, one a line")
    known = {_shown_name(p): p for p in context.command.params if p.expose_value}
    strangers = [str(key) for key in found if key not in known]
    if strangers:
        raise ValueError(
            f"{path}: {context.command.name} has no option {strangers[0]!r}; it has "
            f"{listed(sorted(known), strangers[0])}"
        )
    values = {known[key].name: _as_given(known[key], value) for key, value in found.items()}
    context.default_map = {**(context.default_map or {}), **values}


def _shown_name(param: Any) -> str:
    """Return what a person calls a parameter: `test-fraction`, `dataset`."""
    longest = max(param.opts, key=len)
    return longest.removeprefix("--")


def _as_given(param: Any, value: Any) -> Any:
    """Return a value as the command line would have given it."""
    many = getattr(param, "multiple", False) or param.nargs == -1
    if many or isinstance(value, list):
        return [str(one) for one in (value if isinstance(value, list) else [value])]
    return value if isinstance(value, bool) or value is None else str(value)


def _be_verbose(asked: bool) -> None:
    if asked:
        printer.set_talk(printer.Talk.VERBOSE)


def _be_quiet(asked: bool) -> None:
    if asked:
        printer.set_talk(printer.Talk.QUIET)


def _declared(
    options: Annotated[
        Path | None,
        typer.Option(
            "--options",
            metavar="FILE",
            help="YAML of options, such as `test-fraction: 0.3`; the command line wins.",
            callback=_take_options,
            is_eager=True,
        ),
    ] = None,
    verbose: Annotated[
        bool,
        typer.Option(
            "--verbose", "-v", help="Tell how long each stage took.", callback=_be_verbose
        ),
    ] = False,
    quiet: Annotated[
        bool,
        typer.Option(
            "--quiet", "-q", help="Say nothing but warnings and errors.", callback=_be_quiet
        ),
    ] = False,
) -> None:
    pass
