"""Plain values of options are what Typer would make of them; it is asked about all others."""

import subprocess
import sys
from pathlib import Path
from typing import Annotated

import pytest
import typer

from nico_selfmodel.cli.plain_values import take_plain_values


def command_of(function):
    app = typer.Typer(add_completion=False)
    app.command()(function)
    return typer.main.get_command(app)


def outcome(function, words, *, plain):
    """Return what a function was given, or what was said of the words."""
    command = command_of(function)
    if plain:
        take_plain_values(command)
    try:
        return command.main(list(words), standalone_mode=False)
    except Exception as error:
        return type(error).__name__, str(error.format_message())


def words_of(text: Annotated[str, typer.Option("--text")] = "a b"):
    return text


def paths_of(paths: Annotated[list[Path], typer.Argument()]):
    return paths


def whole_of(n: Annotated[int, typer.Option("--n", min=1, max=50)] = 10):
    return n, type(n)


def number_of(x: Annotated[float | None, typer.Option("--x")] = None):
    return x, type(x)


def flag_of(on: Annotated[bool, typer.Option("--on/--off")] = True):
    return on


def repeated_of(name: Annotated[list[str] | None, typer.Option("--name")] = None):
    return name


def pair_of(pair: Annotated[tuple[float, float], typer.Option("--pair")] = (1.0, 2.0)):
    return pair


CASES = [
    *((words_of, words) for words in ([], ["--text", ""], ["--text", "ä\nb"], ["--text"])),
    *((paths_of, words) for words in (["a"], ["a", "./b/../c"], [])),
    *(
        (whole_of, ["--n", n])
        for n in ("7", "+7", "007", "0", "51", "7.0", "x", "1_0", "٣", "9" * 30)
    ),
    *(
        (number_of, ["--x", x])
        for x in ("1", "-1.5", ".5", "2.", "1e-3", "inf", "nan", "x", "1e999")
    ),
    *((flag_of, words) for words in ([], ["--off"], ["--on"])),
    *((repeated_of, words) for words in ([], ["--name", "a", "--name", "b"])),
    *((pair_of, words) for words in ([], ["--pair", "1", "2"], ["--pair", "1", "b"])),
    (whole_of, []),
    (number_of, []),
]


@pytest.mark.parametrize(("function", "words"), CASES)
def test_what_a_command_is_given_is_what_typer_gives(function, words):
    found, expected = (repr(outcome(function, words, plain=plain)) for plain in (True, False))
    assert found == expected


def test_a_command_of_plain_words_does_not_load_pydantic(tmp_path):
    code = (
        "import sys; sys.argv = ['nico-selfmodel', 'evaluate', 'a', 'b', '--sensor', 'points']\n"
        "from nico_selfmodel.cli.main import main\n"
        "try: main()\n"
        "except SystemExit: pass\n"
        "assert 'typer' in sys.modules\n"
        "print('pydantic' in sys.modules)"
    )
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=tmp_path, capture_output=True, text=True
    )
    assert done.stdout.split() == ["False"], done.stderr
    assert "a does not exist" in done.stderr  # it was run
