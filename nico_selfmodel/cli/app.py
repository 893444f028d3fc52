"""The command tree, and what an error looks like."""

import io
import logging
import re
import sys
import warnings
from functools import cache
from typing import Annotated, Any

import typer

from nico_selfmodel import __version__
from nico_selfmodel.cli import interruption, printer
from nico_selfmodel.cli.commands import ORDER, Commands, commands_named
from nico_selfmodel.cli.habits import add_habits
from nico_selfmodel.cli.option_groups import unfolded
from nico_selfmodel.cli.plain_values import take_plain_values
from nico_selfmodel.errors import SelfModelError

_LONGEST_LINE = 1000
"""Of what is said to a person [characters]; paths may take most of it."""

_WITH_NEGATIVE_NUMBERS = ("move",)
"""Commands with an argument that may begin with a minus, and is no option then."""


def _group(text: str, commands: Commands, *, completion: bool = False) -> typer.Typer:
    group = typer.Typer(
        help=text,
        no_args_is_help=True,
        add_completion=completion,
        pretty_exceptions_enable=False,
        rich_markup_mode=None,
    )
    group.callback(help=text)(lambda: None)
    for name, command in commands.items():
        lenient = name in _WITH_NEGATIVE_NUMBERS
        settings = {"ignore_unknown_options": lenient}
        group.command(name, context_settings=settings)(unfolded(command))
    return group


def run() -> None:
    """Run the command line; an error is one clear line and exit code 2."""
    warnings.showwarning = tell = _Warnings()
    _let_drake_warn_in_one_line(tell)
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):  # a name may hold what a terminal cannot show
            stream.reconfigure(errors="backslashreplace")
    command = _tree(*sys.argv[1:3])
    printer.set_talk(printer.Talk.PLAIN)
    try:
        _refuse_empty(sys.argv[1:])
        code = command.main(prog_name="nico-selfmodel", standalone_mode=False)
        if code == interruption.CODE:  # Typer took Ctrl-C, and said nothing
            code = interruption.say_stopped()
    except (SelfModelError, ValueError, OSError) as error:
        sys.stdout.flush()
        code = _complain(_one_line(error))
    except MemoryError:
        code = _complain("there is not enough memory for this")
    except (KeyboardInterrupt, typer.Abort):
        code = interruption.say_stopped()
    except Exception as error:
        stopped = interruption.was_stopped(error)
        code = interruption.say_stopped() if stopped else _usage(error)
    raise SystemExit(code if isinstance(code, int) else 0)


@cache
def _tree(*words: str) -> Any:
    """Return the commands that the first words name, or all."""
    commands, groups = commands_named(words)
    # Typer carries a copy of click of its own, so that a command's type has no public name.
    app = _group("A robot learns its own body by watching it move.", commands, completion=True)
    app.callback(help="A robot learns its own body by watching it move.")(_root)
    for name, (text, below) in groups.items():
        app.add_typer(_group(text, below), name=name)
    command: Any = typer.main.get_command(app)
    command.commands = {name: command.commands[name] for name in ORDER if name in command.commands}
    add_habits(command)
    take_plain_values(command)
    return command


def _tell_version(asked: bool) -> None:
    if asked:
        printer.line(f"nico-selfmodel {__version__}")
        raise typer.Exit


def _root(
    version: Annotated[
        bool,
        typer.Option("--version", help="Print the version.", callback=_tell_version, is_eager=True),
    ] = False,
) -> None:
    pass


def _refuse_empty(words: list[str]) -> None:
    """Refuse a word that says nothing: a shell variable that was never set, most of the time."""
    for before, word in zip(["", *words], words, strict=False):
        if not word.strip():
            place = before if before.startswith("--") else "an argument"
            raise ValueError(f"{place} is empty: give it a value, or leave it out")
        option, equals, value = word.partition("=")
        if option.startswith("--") and equals and not value.strip():
            raise ValueError(f"{option} is empty: give it a value, or leave it out")


def _complain(reason: str, code: int = 2) -> int:
    print(f"nico-selfmodel: {_harmless(reason)}", file=sys.stderr)
    return code


def _harmless(text: str) -> str:
    """Return text in one line of bearable length that no terminal obeys."""
    plain = " ".join(text.split())
    plain = "".join(c if c.isprintable() else c.encode("unicode_escape").decode() for c in plain)
    if len(plain) <= _LONGEST_LINE:
        return plain
    half = _LONGEST_LINE // 2
    return f"{plain[:half]} ... {plain[-half:]}"


class _Warnings:
    """Shows what is valid but doubtful in one line, each text once."""

    def __init__(self) -> None:
        """Begin with nothing told."""
        self._told = set[str]()

    def __call__(self, message: Warning | str, *_: object, **__: object) -> None:
        """Show a warning, as `warnings.showwarning` does."""
        text = _harmless(str(message))
        if text not in self._told:
            self._told.add(text)
            print(f"nico-selfmodel: warning: {text}", file=sys.stderr)


class _OneLine(logging.Handler):
    """Shows what Drake has to say as a warning of ours."""

    def __init__(self, tell: _Warnings) -> None:
        """Tell it by what tells ours."""
        super().__init__()
        self._tell = tell

    def emit(self, record: logging.LogRecord) -> None:
        # A page that asks for a picture of a moment ago is told so by Meshcat, and asks again.
        if record.levelno >= logging.WARNING and "Unknown CAS key" not in record.getMessage():
            self._tell(record.getMessage())


def _let_drake_warn_in_one_line(tell: _Warnings) -> None:
    drake = logging.getLogger("drake")
    drake.propagate = False
    drake.handlers = [_OneLine(tell)]


def _usage(error: Exception) -> int:
    """Say in one line what is wrong with the words of a command; anything else is a bug."""
    # Typer's copy of click again: its exceptions have no public name either.
    format_message = getattr(error, "format_message", None)
    if format_message is None:
        raise error
    if type(error).__name__ == "NoArgsIsHelpError":
        print(str(error))
        return 2
    context = getattr(error, "ctx", None)
    path = context.command_path if context else "nico-selfmodel"
    message = _in_plain_words(" ".join(str(format_message()).split()))
    given = _given(getattr(error, "param", None), context) or _refused_by(error.__cause__)
    if message.startswith("Invalid value") and given is not None and repr(given) not in message:
        message += f", got {given!r}"
    message += "" if message.endswith((".", "?", "!")) else "."
    commands = getattr(context and context.command, "commands", None)
    if commands and message.startswith("No such command") and "Did you mean" not in message:
        message += f" There are {', '.join(commands)}."
    return _complain(f"{message} See: {path} --help")


def _in_plain_words(message: str) -> str:
    """Return a message without the language of the library that reads numbers for Typer."""
    message = re.sub(
        r"Input should be a valid integer(, .*as an integer)?", "expected a whole number", message
    )
    message = re.sub(
        r"Input should be a valid number(, .*as a number)?", "expected a number", message
    )
    message = re.sub(r"Input should be a valid boolean(, .*)?$", "expected true or false", message)
    message = message.replace("Input should be greater than or equal to", "expected at least")
    return message.replace("Input should be less than or equal to", "expected at most")


def _given(param: Any, context: Any) -> str | None:
    """Return what the command line, or a file of options, gives an option; None if nothing."""
    given = None
    for word, following in zip(sys.argv, [*sys.argv[1:], None], strict=True):
        name, equals, value = word.partition("=")
        if name in getattr(param, "opts", ()):
            given = value if equals else following
    in_file = (getattr(context, "default_map", None) or {}).get(getattr(param, "name", None))
    return given if given is not None or in_file is None else str(in_file)


def _refused_by(cause: Any) -> str | None:
    """Return the value that the library refuses which reads numbers for Typer; None if none."""
    errors = getattr(cause, "errors", list)()
    return str(errors[0]["input"]) if errors and "input" in errors[0] else None


def _one_line(error: Exception) -> str:
    if isinstance(error, OSError) and error.strerror and error.filename:
        return f"{error.filename}: {error.strerror}"
    if type(error).__name__ == "LinAlgError":  # numpy is not loaded for this
        return (
            "the calculation broke down: a number in what was read must be far from what it stands "
            "for; check units, and the self-model if it was edited"
        )
    return str(error).strip() or type(error).__name__
