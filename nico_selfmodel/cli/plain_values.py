"""Values of options that are surely what they should be, taken as they are.

Typer leaves each to pydantic, which loads for longer than many a command runs. It is still asked of
whatever is not plain, and says what is wrong with it.
"""

import re
from collections.abc import Callable
from pathlib import Path
from typing import Any, get_args, get_origin

import typer

_PLAIN: dict[type, str] = {
    str: ".*",
    Path: ".*",
    int: r"[+-]?[0-9]{1,18}",
    float: r"[+-]?[0-9]{1,18}(\.[0-9]{0,30})?([eE][+-]?[0-9]{1,2})?",
}
"""What a command takes -> what such a word looks like at its plainest."""


def take_plain_values(command: Any) -> None:
    """Let a command, and all below it, take plain values without asking pydantic.

    Args:
        command: The root of the tree of commands; its types have no public name.
    """
    for below in getattr(command, "commands", {}).values():
        take_plain_values(below)
    for param in (*command.params, command.get_help_option(typer.Context(command))):
        asked = getattr(param, "get_runtime_param", None)
        if asked is not None:
            param.get_runtime_param = lambda asked=asked: _Plain(asked)


class _Plain:
    """What Typer has a value converted by."""

    def __init__(self, otherwise: Callable[[], Any]) -> None:
        self._otherwise = otherwise

    def coerce(self, value: Any, param: Any, ctx: Any) -> Any:
        """Return a value as its command takes it."""
        many = param.multiple or param.nargs == -1
        if value is None:
            return () if many else None
        descriptor = param.type_descriptor
        kind, limits = descriptor.annotation, descriptor.parameter_info
        if get_origin(kind) is list:
            (kind,) = get_args(kind)
        bounds = (getattr(limits, "min", None), getattr(limits, "max", None))
        words = list(value) if many and isinstance(value, list | tuple) else [value]
        if many == (get_origin(descriptor.annotation) is list) and all(
            _is_plain(word, kind, bounds) for word in words
        ):
            return [kind(word) for word in words] if many else kind(value)
        return self._otherwise().coerce(value, param=param, ctx=ctx)


def _is_plain(word: Any, kind: Any, bounds: tuple[float | None, float | None]) -> bool:
    """Return whether a word, or a value that is one already, is surely of a kind and in bounds."""
    if kind not in _PLAIN or not isinstance(word, str | kind):
        return False
    if isinstance(word, str) and not re.fullmatch(_PLAIN[kind], word, re.DOTALL):
        return False
    low, high = bounds
    return (low is None or kind(word) >= low) and (high is None or kind(word) <= high)
