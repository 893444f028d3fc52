"""Files and folders are written whole or not at all."""

import subprocess
import sys
from pathlib import Path

import pytest

from nico_selfmodel.files.whole import (
    folder_in_place_of,
    folder_written_whole,
    recover,
    refuse_existing,
    refuse_folder,
    write_whole,
)


@pytest.fixture
def result(tmp_path):
    """Return an existing result folder."""
    folder = tmp_path / "result"
    folder.mkdir()
    (folder / "result.json").write_text("{}")
    (folder / "old.txt").write_text("old")
    return folder


def names_in(folder):
    return sorted(path.name for path in folder.iterdir())


def failing_on_call(monkeypatch, number):
    """Let the rename of that number fail, as a full or torn disk would."""
    calls, real = [], Path.replace

    def replace(self, target):
        calls.append(self)
        if len(calls) == number:
            raise OSError("the disk is gone")
        return real(self, target)

    monkeypatch.setattr(Path, "replace", replace)


@pytest.mark.parametrize("old", [None, "old text"])
def test_a_text_is_written_as_utf8_with_its_own_line_ends(tmp_path, old):
    path = tmp_path / "a.yaml"
    if old:
        path.write_text(old)
    write_whole(path, "α\nβ\n")
    assert path.read_bytes() == "α\nβ\n".encode()
    assert path.stat().st_mode & 0o777 == 0o644
    assert names_in(tmp_path) == ["a.yaml"]


def test_a_text_that_cannot_be_written_leaves_the_old_file(tmp_path, monkeypatch):
    path = tmp_path / "a.yaml"
    path.write_text("old")
    with pytest.raises(UnicodeEncodeError):
        write_whole(path, "half a text \ud800")
    failing_on_call(monkeypatch, 1)
    with pytest.raises(OSError, match="disk is gone"):
        write_whole(path, "new")
    assert path.read_text() == "old"
    assert names_in(tmp_path) == ["a.yaml"]


def test_a_file_in_a_missing_folder_is_an_error_not_a_new_folder(tmp_path):
    with pytest.raises(FileNotFoundError):
        write_whole(tmp_path / "nowhere" / "a.yaml", "text")
    assert names_in(tmp_path) == []


def test_a_folder_appears_only_when_it_is_complete(tmp_path):
    path = tmp_path / "above" / "result"
    with folder_written_whole(path) as folder:
        (folder / "a.txt").write_text("1")
        assert not path.exists()
        assert folder.parent == path.parent
    assert (path / "a.txt").read_text() == "1"
    assert names_in(path.parent) == ["result"]
    assert path.stat().st_mode & 0o777 == 0o755


@pytest.mark.parametrize("interruption", [ValueError, KeyboardInterrupt])
def test_an_interrupted_folder_leaves_nothing_behind(tmp_path, interruption):
    def write_half():
        with folder_written_whole(tmp_path / "result") as folder:
            (folder / "a.txt").write_text("half")
            raise interruption("stop")

    with pytest.raises(interruption, match="stop"):
        write_half()
    assert names_in(tmp_path) == []


def test_an_interrupted_replacement_leaves_the_old_folder(tmp_path, result):
    def write_half():
        with folder_written_whole(result, force=True) as folder:
            (folder / "a.txt").write_text("half")
            raise ValueError("stop")

    with pytest.raises(ValueError, match="stop"):
        write_half()
    assert names_in(tmp_path) == ["result"]
    assert names_in(result) == ["old.txt", "result.json"]


def test_force_swaps_the_whole_folder_and_mixes_nothing(tmp_path, result):
    with folder_written_whole(result, force=True) as folder:
        (folder / "new.txt").write_text("new")
        assert names_in(result) == ["old.txt", "result.json"]
    assert names_in(result) == ["new.txt"]
    assert names_in(tmp_path) == ["result"]


@pytest.mark.parametrize("call", [1, 2])
def test_a_swap_that_fails_half_way_brings_the_old_folder_back(tmp_path, result, monkeypatch, call):
    failing_on_call(monkeypatch, call)

    def swap():
        with folder_written_whole(result, force=True) as folder:
            (folder / "new.txt").write_text("new")

    with pytest.raises(OSError, match="disk is gone"):
        swap()
    assert names_in(result) == ["old.txt", "result.json"]
    assert names_in(tmp_path) == ["result"]


def test_an_existing_folder_is_refused_before_any_work(result):
    def write():
        with folder_written_whole(result):
            pytest.fail("the block must not run")

    with pytest.raises(FileExistsError, match="--force"):
        write()
    with pytest.raises(FileExistsError, match="exists already"):
        refuse_existing(result)
    refuse_existing(result, force=True)
    refuse_existing(result / "new")


def test_force_never_replaces_what_is_not_a_result(tmp_path):
    work = tmp_path / "work"
    (work / "deep").mkdir(parents=True)
    (work / "deep" / "thesis.tex").write_text("years")
    with pytest.raises(FileExistsError, match="not a result"):
        refuse_folder(work, force=True)
    assert (work / "deep" / "thesis.tex").read_text() == "years"
    (tmp_path / "empty").mkdir()
    refuse_folder(tmp_path / "empty", force=True)


def test_force_never_replaces_a_folder_that_holds_what_is_read(result):
    (result / "recordings").mkdir()
    for source in (result, result / "recordings", result / "recordings" / "train"):
        with pytest.raises(FileExistsError, match="is read"):
            refuse_folder(result, force=True, inputs=[None, source])
    refuse_folder(result, force=True, inputs=[result.parent / "elsewhere"])


def test_a_file_is_not_written_over_the_one_it_is_made_of_nor_over_a_folder(result):
    read = result / "old.txt"
    with pytest.raises(FileExistsError, match=r"old\.txt is read: choose another name"):
        refuse_existing(read, force=True, inputs=[read])
    refuse_existing(read, force=True, inputs=[result / "result.json", result])
    with pytest.raises(IsADirectoryError, match="result is a folder, a file is to be made"):
        write_whole(result, "text")
    assert read.is_file()


def test_no_file_of_a_folder_that_is_read_is_replaced_but_pages_and_the_like(result):
    for name in ("samples.csv", "self_model.yaml", "scene.json", "page.html"):
        (result / name).write_text("before")
    refuse_existing(result / "page.html", force=True, inputs=[result])
    refuse_existing(result / "new.csv", force=True, inputs=[result])
    for name in ("samples.csv", "self_model.yaml", "scene.json"):
        with pytest.raises(FileExistsError, match=f"{name} lies in .*result, which is read"):
            refuse_existing(result / name, force=True, inputs=[result])
        refuse_existing(result / name, force=True, inputs=[result.parent / "elsewhere"])


def test_a_place_where_nothing_can_be_written_is_refused_before_any_work(result, monkeypatch):
    before = sorted(path.name for path in result.iterdir())
    refuse_existing(result / "far" / "away")
    with pytest.raises(NotADirectoryError, match=r"old\.txt is not a folder"):
        refuse_existing(result / "old.txt" / "new")
    assert sorted(path.name for path in result.iterdir()) == before

    def read_only(*_, **__):
        raise OSError(30, "Read-only file system")

    monkeypatch.setattr("os.mkdir", read_only)
    with pytest.raises(PermissionError, match=r"result cannot be written to \(Read-only"):
        refuse_existing(result / "far" / "away")


KILLED = """
import os, signal, sys
from pathlib import Path
from nico_selfmodel.files.whole import folder_in_place_of, write_whole
from nico_selfmodel.files import whole
path, when = Path(sys.argv[1]), sys.argv[2]
real, calls = Path.replace, []
def replace(self, target):
    calls.append(self)
    if when == str(len(calls)):
        os.kill(os.getpid(), signal.SIGKILL)
    return real(self, target)
Path.replace = replace
if when == "file":
    Path.chmod = lambda *_: os.kill(os.getpid(), signal.SIGKILL)
    write_whole(path, "new")
with folder_in_place_of(path, keep_others=True) as folder:
    (folder / "result.json").write_text("new")
    if when == "0":
        os.kill(os.getpid(), signal.SIGKILL)
"""


def killed(path, when):
    done = subprocess.run([sys.executable, "-c", KILLED, str(path), when], check=False)
    assert done.returncode == -9


@pytest.mark.parametrize("when", ["0", "1", "2", "3"])
def test_what_a_killed_process_left_is_tidied_up_by_the_next_one(tmp_path, result, when):
    """Killed while it writes, or before the old folder, the new one or another file is moved."""
    killed(result, when)
    assert len(names_in(tmp_path)) > 1 or not result.exists()
    recover(result)
    assert names_in(tmp_path) == ["result"]
    assert names_in(result) == ["old.txt", "result.json"]
    assert (result / "result.json").read_text() == ("new" if when == "3" else "{}")


def test_a_killed_file_is_tidied_up_too(tmp_path):
    path = tmp_path / "a.yaml"
    killed(path, "file")
    assert len(names_in(tmp_path)) == 1
    write_whole(path, "text")
    assert names_in(tmp_path) == ["a.yaml"]


def test_what_a_living_process_writes_is_left_to_it(result):
    with folder_in_place_of(result) as folder:
        recover(result)
        assert folder.exists()
        (folder / "result.json").write_text("new")
    assert (result / "result.json").read_text() == "new"


def test_what_only_looks_like_left_over_stays(tmp_path):
    others = [".result.part.txt", ".results.abc.part", "result.abc.part", ".result"]
    for name in others:
        (tmp_path / name).write_text("mine")
    recover(tmp_path / "result")
    assert names_in(tmp_path) == sorted(others)


@pytest.mark.parametrize("name", ["a" * 255, "ü" * 127, "a" * 250 + ".txt"])
def test_a_name_may_be_as_long_as_the_file_system_takes(tmp_path, name):
    write_whole(tmp_path / name, "text")
    assert names_in(tmp_path) == [name]
    (tmp_path / name).unlink()
    with folder_written_whole(tmp_path / name) as folder:
        (folder / "a.txt").write_text("1")
    assert names_in(tmp_path) == [name]


@pytest.mark.parametrize(
    ("path", "message"),
    [
        ("a" * 256, "a name of 256 bytes"),
        ("ü" * 128, "a name of 256 bytes"),
        ("a" * 300 + "/b", "a name of 300 bytes"),
        ("/".join(["a" * 200] * 20), "a path has at most 3900 bytes"),
        ("a\udc80", "is not a name in UTF-8"),
    ],
)
def test_a_name_that_is_too_long_is_refused_before_any_work(tmp_path, path, message):
    with pytest.raises(ValueError, match=message) as caught:
        refuse_folder(tmp_path / path)
    assert len(str(caught.value)) < 300
    assert names_in(tmp_path) == []
