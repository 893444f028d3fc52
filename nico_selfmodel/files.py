"""Files and folders that are written whole or not at all."""

import os
import shutil
import tempfile
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path


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
        content: The whole file.

    Raises:
        OSError: If the folder is missing or cannot be written to.
    """
    path = Path(path)
    if not path.parent.is_dir():
        raise FileNotFoundError(f"{path} cannot be written: {path.parent} is not a folder")
    handle, temporary = tempfile.mkstemp(prefix=f".{path.name}.", dir=path.parent)
    try:
        with os.fdopen(handle, "wb") as file:
            file.write(content)
        Path(temporary).chmod(0o644)
        Path(temporary).replace(path)
    except BaseException:
        Path(temporary).unlink(missing_ok=True)
        raise


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
    path = Path(path)
    refuse_folder(path, force=force)
    path.parent.mkdir(parents=True, exist_ok=True)
    temporary = Path(tempfile.mkdtemp(prefix=f".{path.name}.", dir=path.parent))
    try:
        temporary.chmod(0o755)
        yield temporary
        _swap(temporary, path)
    except BaseException:
        shutil.rmtree(temporary, ignore_errors=True)
        raise


def _swap(new: Path, path: Path) -> None:
    """Put a folder in the place of another, which comes back if that fails."""
    if not path.is_dir():
        new.replace(path)
        return
    aside = Path(tempfile.mkdtemp(prefix=f".{path.name}.old.", dir=path.parent))
    try:
        path.replace(aside)
        try:
            new.replace(path)
        except BaseException:
            aside.replace(path)
            raise
    finally:
        shutil.rmtree(aside, ignore_errors=True)


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
    refuse_existing(path, force=force)
    if not path.exists():
        return
    if not path.is_dir():
        raise FileExistsError(f"{path} is a file, a folder is to be made: choose another name")
    for source in (Path(source).resolve() for source in inputs if source is not None):
        if path.resolve() in (source, *source.parents):
            raise FileExistsError(f"{path} holds {source}, which is read: choose another name")
    if any(path.iterdir()) and not (path / RESULT_FILE).is_file():
        raise FileExistsError(
            f"{path} holds something that is not a result ({RESULT_FILE}); it is not replaced: "
            "choose another name"
        )


def refuse_existing(path: str | Path, *, force: bool = False) -> None:
    """Refuse to write over something, or where nothing can be written, before any work is done.

    Args:
        path: The file or folder about to be made.
        force: Allow it to be replaced.

    Raises:
        FileExistsError: If it exists and `force` is not set.
        OSError: If the nearest folder above it that exists cannot be written to.
    """
    path = Path(path)
    if path.exists() and not force:
        raise FileExistsError(f"{path} exists already: choose another name or add --force")
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
