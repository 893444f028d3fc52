"""Only regular files of a size that fits are read; nothing is waited for."""

import os
import socket
import subprocess
import sys

import pytest

from nico_selfmodel.errors import DataError
from nico_selfmodel.files.csv_rows import MOST_CELLS, MOST_COLUMNS, number_of_word, rows_of_text
from nico_selfmodel.files.json_text import parse_json
from nico_selfmodel.files.reading import read_bytes, read_text, real_path


def test_a_named_pipe_is_refused_and_not_waited_for(tmp_path):
    os.mkfifo(tmp_path / "pipe.png")
    with pytest.raises(DataError, match=r"pipe\.png: is a named pipe, a file was expected"):
        read_bytes(tmp_path / "pipe.png", 100)


def test_sockets_devices_and_folders_are_refused(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)  # the name of a socket must be short
    with socket.socket(socket.AF_UNIX) as listening:
        listening.bind("s.png")
        with pytest.raises(DataError, match=r"is a socket, a file was expected"):
            read_bytes(tmp_path / "s.png", 100)
    for path, words in (
        (tmp_path, "is a folder, a file was expected"),
        (tmp_path.joinpath("/dev/zero"), "a device"),
    ):
        with pytest.raises(DataError, match=words):
            read_bytes(path, 100)


def test_what_a_shell_hands_over_is_read_though_it_is_a_pipe(tmp_path):
    code = (
        "import sys; from pathlib import Path; from nico_selfmodel.files.reading import read_text;"
        "print(read_text(Path(sys.argv[1]), 100))"
    )
    done = subprocess.run(
        ["bash", "-c", f"'{sys.executable}' -c '{code}' <(echo hello)"],
        capture_output=True,
        text=True,
        check=True,
    )
    assert done.stdout.strip() == "hello"


def test_a_file_larger_than_the_limit_is_not_read(tmp_path):
    path = tmp_path / "large"
    path.write_bytes(b"x" * 2_000_001)
    assert len(read_bytes(path, 2_000_001)) == 2_000_001
    with pytest.raises(DataError, match="larger than 2 MB"):
        read_bytes(path, 2_000_000)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"", "the file is empty"),
        (b"\xff", r"not UTF-8 text \(byte 0\)"),
        (b"a\n\0", "line 2.*NUL"),
    ],
)
def test_what_is_not_text_is_refused(tmp_path, content, message):
    path = tmp_path / "text"
    path.write_bytes(content)
    with pytest.raises(DataError, match=message):
        read_text(path, 100)


def test_a_name_that_no_file_can_have_is_refused(tmp_path):
    for name in ("a" * 300, "a\0b"):
        with pytest.raises(DataError, match="cannot be read"):
            read_bytes(tmp_path / name, 100)


def test_a_link_that_leads_to_itself_is_no_riddle(tmp_path, command):
    path = tmp_path / "a.png"
    path.symlink_to("a.png")
    assert real_path(path) == path
    done = command("pick-color", path, "--at", "2,2", "--out", tmp_path / "red.yaml")
    assert done.returncode == 2
    assert done.stderr.startswith(f"nico-selfmodel: {path}: cannot be read: Too many levels")


@pytest.mark.slow
def test_tables_have_limits():
    rows, _ = rows_of_text("a," * (MOST_COLUMNS - 1) + "a\n", "t")
    assert len(rows[0]) == MOST_COLUMNS
    with pytest.raises(DataError, match="at most 10000 columns"):
        rows_of_text("a," * MOST_COLUMNS + "a\n", "t")
    with pytest.raises(DataError, match=f"{MOST_CELLS} cells"):
        rows_of_text(("," * 9_999 + "\n") * (MOST_CELLS // 10_000 + 1), "t")
    with pytest.raises(DataError, match="field larger than field limit"):
        rows_of_text("x" * 200_000, "t")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("[" * 100_000, "nested too deep"),
        ('{"a": NaN}', "'NaN' is no number"),
        ('{"a": 1e999}', "'1e999' is no number"),
        ('{"a": %s}' % ("9" * 5000), "is no number"),
        ('{"a": 1, "a": 2}', "key 'a' stands twice"),
        ("{", "not valid JSON"),
    ],
)
def test_hostile_json_is_refused(text, message):
    with pytest.raises(DataError, match=message) as caught:
        parse_json(text, "the scene")
    assert len(str(caught.value)) < 200


@pytest.mark.parametrize(
    ("word", "message"),
    [
        ("", "--at: '' is not a number"),
        ("x", "--at: 'x' is not a number"),
        ("nan", "--at: 'nan' is not a finite number$"),
        ("1e308", "--at: '1e308' is larger than anything measured"),
        ("1,5", "use a decimal point"),
    ],
)
def test_a_word_that_is_no_number_is_refused_with_its_option(word, message):
    with pytest.raises(ValueError, match=message):
        number_of_word(word, "--at")
    assert number_of_word(" -1.5e3", "--at") == -1500.0
