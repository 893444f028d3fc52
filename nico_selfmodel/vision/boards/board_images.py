"""Photographs of boards: which file is which view of which camera."""

import re
from collections.abc import Iterable, Sequence
from glob import has_magic
from pathlib import Path

from nico_selfmodel.errors import DataError
from nico_selfmodel.names import listed
from nico_selfmodel.vision.images.image_file import image_files, natural_key


def camera_images(folder: str | Path, prefix: str) -> list[tuple[str, Path]]:
    """List the photographs of one camera.

    Args:
        folder: Where they are.
        prefix: How their names begin, such as `left`.

    Returns:
        Name of the view (what follows the prefix) and path, with view 2 before view 10.

    Raises:
        DataError: If the folder is missing, holds no such image or two for one view.
    """
    paths = [p for p in image_files(folder) if p.stem.lower().startswith(prefix.lower())]
    names = [path.stem[len(prefix) :].strip("_-. ") or prefix.lower() for path in paths]
    if not paths:
        raise DataError(
            f"{folder}: no images {prefix}*.png or {prefix}*.jpg; {_holds(folder)}; other names "
            f"are given as a pattern: '{folder}/*.png'"
        )
    return _one_of_each(folder, zip(names, paths, strict=True))


def images_of_one(folder: str | Path, camera: str) -> list[tuple[str, Path]]:
    """List the photographs of a camera that may have a folder of its own.

    Args:
        folder: Where they are.
        camera: How their names begin; all photographs are this camera's if no name begins so, nor
            like one of a pair of cameras.

    Returns:
        Name of the view and path, with view 2 before view 10.

    Raises:
        DataError: If the folder is missing, or holds no such image or two for one view.
    """
    paths = image_files(folder)
    begins = tuple({camera.lower(), "left", "right"})
    if not paths or any(path.stem.lower().startswith(begins) for path in paths):
        return camera_images(folder, camera)
    return camera_images(folder, "")


def stereo_pairs(folder: str | Path) -> list[tuple[str, Path, Path]]:
    """Pair `left*` and `right*` photographs by what follows.

    Args:
        folder: Where they are.

    Returns:
        Name of the view, left path, right path, with view 2 before view 10.

    Raises:
        DataError: If the folder is missing or holds no images, those of one camera only, two for
            one view, or images without a partner; names them.
    """
    names = [path.stem.lower() for path in image_files(folder)]
    sides = [any(name.startswith(side) for name in names) for side in ("left", "right")]
    if not any(sides):
        raise DataError(
            f"{folder}: no stereo images (left*.png or .jpg with right* beside them);"
            f" {_holds(folder)}"
        )
    if not all(sides):
        here, missing = ("left", "right") if sides[0] else ("right", "left")
        raise DataError(
            f"{folder}: images of one camera only: {here}* without {missing}*; a pair needs both"
        )
    left, right = dict(camera_images(folder, "left")), dict(camera_images(folder, "right"))
    if len(left) == len(right) == 1 and set(left) == {"left"} and set(right) == {"right"}:
        return [("pair", left["left"], right["right"])]
    alone = [path.name for name, path in left.items() if name not in right]
    alone += [path.name for name, path in right.items() if name not in left]
    if alone:
        raise DataError(
            f"{folder}: images without a partner in the other camera: {listed(alone, most=6)};"
            " pairs are named alike after left and right, as left01 and right01"
        )
    return [(name, path, right[name]) for name, path in left.items()]


def images_by_pattern(pattern: str) -> list[tuple[str, Path]]:
    """List the photographs that a pattern names.

    Args:
        pattern: Such as `cam0/*.png`; `*`, `**/`, `?` and `[...]` as in a shell.

    Returns:
        Name of the view, what the wildcards stand for, and path; view 2 before view 10.

    Raises:
        DataError: If it names no file, or nothing but one file by its name, or two photographs for
            which the wildcards stand for the same.
    """
    if not has_magic(pattern):
        raise DataError(f"{pattern}: a pattern of photographs has a * in it, as 'cam0/*.png'")
    inside = re.compile(_expression(str(Path(pattern))))
    found = []
    start = Path(Path(pattern).anchor)
    for path in start.glob(str(Path(pattern).relative_to(start))):
        match = inside.fullmatch(str(path))
        if match is not None and path.is_file():
            parts = [part.strip("/").replace("/", "_") for part in match.groups() if part]
            found.append(("_".join(parts), path))
    if not found:
        raise DataError(f"{pattern}: no photograph has such a name; is the pattern quoted?")
    return _one_of_each(pattern, sorted(found, key=lambda item: natural_key(item[1])))


def pairs_by_pattern(left: str, right: str) -> list[tuple[str, Path, Path]]:
    """Pair the photographs of two patterns by what their wildcards stand for.

    Returns:
        Name of the view, left path, right path.

    Raises:
        DataError: If a pattern names no file, or two for one view, or a photograph has no partner;
            names them.
    """
    one, two = dict(images_by_pattern(left)), dict(images_by_pattern(right))
    alone = [str(path) for name, path in one.items() if name not in two]
    alone += [str(path) for name, path in two.items() if name not in one]
    if alone:
        raise DataError(
            f"photographs without a partner in the other camera: {listed(alone, most=6)}; what "
            f"stands for * in {left} and {right} must be the same of both"
        )
    return [(name, path, two[name]) for name, path in one.items()]


def images_by_folder(folder: str | Path) -> dict[str, list[tuple[str, Path]]]:
    """List the photographs of a rig: each folder inside one is a camera.

    Photographs of different cameras with one name (whatever their ending) were taken at one time.

    Returns:
        Camera -> name of the view and path.

    Raises:
        DataError: If the folder is missing, or holds no folder with photographs, or one with two
            of one name.
    """
    if not Path(folder).is_dir():
        raise DataError(f"{folder}: no such folder")
    inside = sorted(filter(Path.is_dir, Path(folder).iterdir()), key=natural_key)
    found = {
        path.name: _one_of_each(path, [(p.stem, p) for p in image_files(path)]) for path in inside
    }
    cameras = {camera: images for camera, images in found.items() if images}
    if not cameras:
        raise DataError(
            f"{folder}: expected a folder with photographs for each camera, as cam0 and cam1; "
            f"{_holds(folder)}"
        )
    return cameras


def images_by_name(words: Sequence[str]) -> dict[str, list[tuple[str, Path]]]:
    """List the photographs of cameras by words like `front=cam0/*.png`.

    Photographs for which the wildcards stand for the same were taken at one time.

    Returns:
        Camera -> name of the view and path.

    Raises:
        DataError: If a pattern names no photograph, or two for one view.
        ValueError: If a word is something else, or two name one camera.
    """
    found: dict[str, list[tuple[str, Path]]] = {}
    for word in words:
        camera, equals, pattern = word.partition("=")
        if not (camera and equals and pattern):
            raise ValueError(f"--images {word}: give NAME=PATTERN, as front='cam0/*.png'")
        if camera in found:
            raise ValueError(f"--images {word}: there is another camera {camera}")
        found[camera] = images_by_pattern(pattern)
    return found


def _expression(pattern: str) -> str:
    """Return a regular expression whose groups are what wildcards stand for."""
    parts = re.split(r"(\*\*/|\*+|\?|\[[^\]]+\])", pattern)
    words = {"?": "([^/])", "**/": "((?:[^/]+/)*)"}
    found = (
        re.escape(part)
        if k % 2 == 0
        else words.get(part, f"({part.replace('[!', '[^')})" if part[0] == "[" else "([^/]*)")
        for k, part in enumerate(parts)
    )
    return "".join(found)


def _one_of_each(where: str | Path, images: Iterable[tuple[str, Path]]) -> list[tuple[str, Path]]:
    """Return name of the view and path of photographs, no two of which may be one view.

    Args:
        where: Folder or pattern, for the message.

    Raises:
        DataError: If two are; names them.
    """
    found: dict[str, Path] = {}
    for name, path in images:
        if name in found:
            one, two = found[name], path
            same = one.parent == two.parent
            raise DataError(
                f"{where}: {one.name if same else one} and {two.name if same else two} are the same"
                f" view, {name!r}: each view needs a name of its own; remove or rename one"
            )
        found[name] = path
    return list(found.items())


def _holds(folder: str | Path) -> str:
    names = sorted(path.name for path in Path(folder).iterdir() if not path.name.startswith("."))
    return f"it holds {listed(names, most=6)}" if names else "it is empty"
