"""Files and folders are written whole or not at all."""

from pathlib import Path

import pytest

from nico_selfmodel.files import folder_written_whole, refuse_existing, refuse_folder, write_whole


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
        with pytest.raises(FileExistsError, match="which is read"):
            refuse_folder(result, force=True, inputs=[None, source])
    refuse_folder(result, force=True, inputs=[result.parent / "elsewhere"])


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
