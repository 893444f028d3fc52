"""Files and folders that are written whole or not at all.

They are written under a temporary name beside their own, `.<name>.<random>.part`, which is locked
as long as the writing process lives: what a killed one left behind is known by its free lock, and
taken away by the next one that writes the same name.
"""

import fcntl
import os
import shutil
import tempfile
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from nico_selfmodel.files.reading import real_path
from nico_selfmodel.names import shown

_NEW, _OLD, _KEPT = ".part", ".old", ".kept"
"""Ends of temporary names: being written; being replaced; being replaced, its other files kept."""
_LONGEST_PART = 200
"""Of a name in a temporary name [bytes]."""
_LONGEST_NAME, _LONGEST_PATH = 255, 3900
"""Of a file and of a path to a result, which holds files itself [bytes]."""
_READ = (".csv", ".json", ".yaml", ".yml")
"""Endings of what data sets, models and results are read from."""


def write_whole(path: str | Path, text: str) -> None:
    """Write a text file through a temporary sibling, so that a failure leaves the old one.

    Args:
        path: Where to write; its folder must exist.
        text: The content, written as UTF-8.

    Raises:
        OSError: If the folder is missing or cannot be written to.
    """
    write_bytes_whole(path, text.encode("utf-8"))


def write_bytes_whole(path: str | Path, content: bytes) -> None:
    """Write a file through a temporary sibling, so that a failure leaves the old one.

    Args:
        path: Where to write; its folder must exist.

    Raises:
        OSError: If the folder is missing or cannot be written to.
    """
    path = Path(path)
    if not path.parent.is_dir():
        raise FileNotFoundError(f"{path} cannot be written: {path.parent} is not a folder")
    if path.is_dir():
        raise IsADirectoryError(f"{path} is a folder, a file is to be made: choose another name")
    recover(path)
    with _temporary(path, _NEW, folder=False) as temporary:
        temporary.write_bytes(content)
        temporary.chmod(0o644)
        temporary.replace(path)


@contextmanager
def folder_written_whole(path: str | Path, *, force: bool = False) -> Iterator[Path]:
    """Give a temporary folder that takes its final name when the block ends well.

    Args:
        path: The final name; folders above it are made.
        force: Replace an earlier result (see `refuse_folder`).

    Yields:
        A temporary sibling folder to write into.

    Raises:
        FileExistsError: If `path` exists and `force` is not set.
        OSError: If the folder above cannot be written to.
    """
    refuse_folder(path, force=force)
    with folder_in_place_of(path) as temporary:
        yield temporary


@contextmanager
def folder_in_place_of(path: str | Path, *, keep_others: bool = False) -> Iterator[Path]:
    """Give a temporary folder that takes the place of another, if there is one, without asking.

    Args:
        path: The final name; folders above it are made.
        keep_others: Keep files of the old folder that the new one does not have.

    Yields:
        A temporary sibling folder to write into.

    Raises:
        OSError: If the folder above cannot be written to.
    """
    path = Path(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    recover(path)
    with _temporary(path, _NEW, folder=True) as temporary:
        temporary.chmod(0o755)
        yield temporary
        _swap(temporary, path, keep_others)


def _swap(new: Path, path: Path, keep_others: bool) -> None:
    """Put a folder in the place of another, which comes back if that fails."""
    if not path.is_dir():
        new.replace(path)
        return
    with _temporary(path, _KEPT if keep_others else _OLD, folder=True) as aside:
        lock = _lock_of_left(path)  # the old folder takes the place of the locked empty one
        try:
            path.replace(aside)
            try:
                new.replace(path)
            except BaseException:
                aside.replace(path)
                raise
            if keep_others:
                _move_others(aside, path)
        finally:
            if lock is not None:
                os.close(lock)


def _move_others(old: Path, new: Path) -> None:
    for other in old.iterdir():
        if not (new / other.name).exists():
            other.replace(new / other.name)


def recover(path: str | Path) -> None:
    """Take away what a process that was killed left beside a file or folder it was writing.

    Where it was killed between the old folder and the new one, the old one comes back.
    """
    path = Path(path)
    if not path.parent.is_dir():
        return
    beginning = f".{_part_of_name(path)}."
    for left in list(path.parent.iterdir()):
        if left.name.startswith(beginning) and left.suffix in (_NEW, _OLD, _KEPT):
            lock = _lock_of_left(left, sure=True)
            if lock is not None:
                with suppress(OSError):
                    _tidy(left, path)
                os.close(lock)


def _tidy(left: Path, path: Path) -> None:
    """Bring an old folder back that lost its place, or take a temporary one away."""
    if left.suffix != _NEW and any(left.iterdir()):
        if not path.exists():
            left.replace(path)
            return
        if left.suffix == _KEPT:
            _move_others(left, path)
    _remove(left)


@contextmanager
def _temporary(path: Path, end: str, *, folder: bool) -> Iterator[Path]:
    """Give a fresh temporary sibling, locked; it is gone afterwards, unless it was moved away."""
    made, lock = _locked_sibling(path, end, folder)
    try:
        yield made
    finally:
        _remove(made)
        os.close(lock)


def _locked_sibling(path: Path, end: str, folder: bool) -> tuple[Path, int]:
    prefix = f".{_part_of_name(path)}."
    while True:
        if folder:
            made = Path(tempfile.mkdtemp(end, prefix, path.parent))
        else:
            handle, name = tempfile.mkstemp(end, prefix, path.parent)
            os.close(handle)
            made = Path(name)
        lock = _lock_of_left(made)
        # Whoever tidies up may have seen it before it was locked: then another one is made.
        if lock is not None and made.exists():
            return made, lock


def _lock_of_left(path: Path, *, sure: bool = False) -> int | None:
    """Return a lock of what no living process writes, to be closed; None where one does.

    On a file system without locks nobody can be sure that none does.
    """
    try:
        handle = os.open(path, os.O_RDONLY)
    except OSError:
        return None
    try:
        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        os.close(handle)
        return None
    except OSError:
        if sure:
            os.close(handle)
            return None
    return handle


def _remove(path: Path) -> None:
    if path.is_dir():
        shutil.rmtree(path, ignore_errors=True)
    else:
        path.unlink(missing_ok=True)


def _part_of_name(path: Path) -> str:
    return os.fsencode(path.name)[:_LONGEST_PART].decode("utf-8", "ignore")


RESULT_FILE = "result.json"
"""What marks a folder as a result of ours, that `force` may replace."""


def refuse_folder(
    path: str | Path, *, force: bool = False, inputs: Iterable[str | Path | None] = ()
) -> None:
    """Refuse a result folder that would destroy something, before any work is done for it.

    Args:
        path: The folder about to be made.
        force: Allow an earlier result, or an empty folder, to be replaced.
        inputs: Files and folders that the work reads; they must not lie in it.

    Raises:
        FileExistsError: If it exists and `force` is not set, it is not a result, or it holds an
            input.
        OSError: If the nearest folder above it that exists cannot be written to.
    """
    path = Path(path)
    refuse_existing(path, force=force, inputs=inputs)
    if not path.exists():
        return
    if not path.is_dir():
        raise FileExistsError(f"{path} is a file, a folder is to be made: choose another name")
    if any(path.iterdir()) and not (path / RESULT_FILE).is_file():
        raise FileExistsError(
            f"{path} holds something that is not a result ({RESULT_FILE}); it is not replaced: "
            "choose another name"
        )


def refuse_existing(
    path: str | Path, *, force: bool = False, inputs: Iterable[str | Path | None] = ()
) -> None:
    """Refuse to write over something, or where nothing can be written, before any work is done.

    Args:
        path: The file or folder about to be made.
        inputs: Files and folders that the work reads: it must not be one, nor hold one, nor be a
            file of one that may be read.

    Raises:
        FileExistsError: If it exists and `force` is not set, or it is, holds or lies in an input.
        OSError: If the nearest folder above it that exists cannot be written to.
        ValueError: If a name is too long, or not UTF-8.
    """
    path = Path(path)
    _check_length(path)
    if path.exists() and not force:
        raise FileExistsError(f"{path} exists already: choose another name or add --force")
    for source in (real_path(source) for source in inputs if source is not None):
        if path.exists() and real_path(path) in (source, *source.parents):
            which = "is read" if real_path(path) == source else f"holds {source}, which is read"
            raise FileExistsError(f"{path} {which}: choose another name")
        if path.exists() and path.suffix in _READ and source in real_path(path).parents:
            raise FileExistsError(f"{path} lies in {source}, which is read: choose another name")
    above = path.absolute().parent
    while not above.exists() and above != above.parent:
        above = above.parent
    if not above.is_dir():
        raise NotADirectoryError(f"{path} cannot be made: {above} is not a folder")
    try:  # permission bits do not tell all: not to root, and not of every file system
        tempfile.TemporaryDirectory(prefix=".", dir=above).cleanup()
    except OSError as error:
        raise PermissionError(
            f"{path} cannot be made: {above} cannot be written to ({error.strerror})"
        ) from error


def _check_length(path: Path) -> None:
    """Refuse names that no file system takes."""
    try:
        longest = max((part.encode() for part in path.parts), key=len, default=b"")
    except UnicodeEncodeError:
        raise ValueError(f"{str(path)!r} is not a name in UTF-8: choose another one") from None
    if len(longest) > _LONGEST_NAME:
        raise ValueError(
            f"{shown(longest.decode())}: a name of {len(longest)} bytes, at most {_LONGEST_NAME} "
            "are possible: choose a shorter one"
        )
    if len(str(path.absolute()).encode()) > _LONGEST_PATH:
        raise ValueError(f"{shown(str(path))}: a path has at most {_LONGEST_PATH} bytes")
