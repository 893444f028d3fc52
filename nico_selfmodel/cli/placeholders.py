"""What stands for a value in help and usage: `PATH`, `NUMBER`, `DATASET`."""

import copy
import inspect
from pathlib import Path
from types import NoneType
from typing import Annotated, Any, get_args

from typer.models import ArgumentInfo, OptionInfo

_PLACEHOLDERS = {Path: "PATH", int: "N", float: "NUMBER", str: "TEXT"}


def with_placeholder(parameter: inspect.Parameter) -> inspect.Parameter:
    """Return a parameter of a command whose help names a value as people do, not as Python does."""
    kind, *said = get_args(parameter.annotation)[:2] or (parameter.annotation,)
    if not said or not isinstance(said[0], ArgumentInfo | OptionInfo) or said[0].metavar:
        return parameter
    told = copy.copy(said[0])
    argument = isinstance(told, ArgumentInfo)
    told.metavar = parameter.name.upper() if argument else _PLACEHOLDERS.get(_value(kind))
    return parameter.replace(annotation=Annotated[kind, told])


def _value(kind: Any) -> Any:
    """Return what each value of a type is: of `list[str] | None` a `str`."""
    inside = [one for one in get_args(kind) if one is not NoneType]
    return _value(inside[0]) if inside else kind
