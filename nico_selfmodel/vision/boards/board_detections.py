"""Folders of photographs of boards, and the boards that are seen in them."""

import hashlib
import warnings
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.dataset.board_views import BoardViews, own_name
from nico_selfmodel.dataset.lattice_places import lattice_of
from nico_selfmodel.errors import DataError
from nico_selfmodel.files.reading import LARGEST_PICTURE, read_bytes, real_path
from nico_selfmodel.names import listed
from nico_selfmodel.progress import Progress
from nico_selfmodel.vision.boards.board_detection import AnyBoard, BoardDetection
from nico_selfmodel.vision.boards.board_images import stereo_pairs
from nico_selfmodel.vision.boards.chessboard import Board, size_of_board
from nico_selfmodel.vision.boards.exact_corners import WINDOW
from nico_selfmodel.vision.images.image_array import turned_colors
from nico_selfmodel.vision.images.image_file import looking_at, natural_key, read_image
from nico_selfmodel.vision.images.not_seen import NotSeen, OtherBoard

_IMAGES_FOR_A_HINT = 6
_WIDEST_WINDOW = 0.7  # of a square; from 0.85 on, corners are drawn to their neighbours


@dataclass(frozen=True, eq=False)
class BoardDetections:
    """One board as cameras saw it."""

    board: AnyBoard
    """What was looked for."""
    views: BoardViews
    """The corners, in the same order in all cameras."""
    files: Mapping[str, Mapping[str, Path]]
    """Camera -> name of the view -> photograph."""
    window: int
    """Half side of the sub-pixel window [px]."""
    not_seen: Mapping[str, str]
    """Name of a file -> what was tried in vain."""

    @property
    def seen_views(self) -> BoardViews:
        """The views in which some camera saw the board; copies are left out with a warning."""
        return _without_copies(self.views.select(self.views.seen.any(axis=(1, 2))))

    @property
    def told_views(self) -> BoardViews:
        """The same, parts of chessboards whose place is not told each by itself."""
        return self.seen_views.apart()

    @property
    def _every(self) -> list[Path]:
        return [path for files in self.files.values() for path in files.values()]

    @property
    def document(self) -> dict[str, Any]:
        """What a result should tell of the detection."""
        labels = _labels(self._every)
        return {
            **self.board.facts,
            "window_px": self.window,
            "images": len(self._every),
            "files": {
                camera: {name: labels[path] for name, path in files.items()}
                for camera, files in self.files.items()
            },
            "not_seen": dict(self.not_seen),
            "in_part": [
                labels[self.files[self.views.cameras[c]][self.views.names[v]]]
                for v, c in np.argwhere(self.views.loose)
            ],
        }

    @property
    def provenance(self) -> dict[str, str]:
        """Where the corners come from, for a self-model: folder, board and hash of all images."""
        digest = hashlib.sha256()
        for path in self._every:
            digest.update(read_bytes(path, LARGEST_PICTURE))
        folder = real_path(self._every[0].parent).name
        return {"images": folder, "board": str(self.board), "images_sha256": digest.hexdigest()}

    def read_images(self) -> dict[str, "Photographs"]:
        """Return the photographs again, each read when it is asked for. Camera -> view -> image."""
        return {camera: Photographs(camera, files) for camera, files in self.files.items()}


class Photographs(Mapping[str, NDArray]):
    """View -> red, green and blue, shape (height, width, 3); one is in memory at a time."""

    def __init__(self, camera: str, files: Mapping[str, Path]) -> None:
        """Remember where they are.

        Args:
            files: View -> photograph.
        """
        self._files = files
        self._own = {own_name(view, camera): view for view in files}

    def __getitem__(self, view: str) -> NDArray:
        view = self._own.get(view, view)
        return turned_colors(read_image(self._files[view]))

    def __iter__(self) -> Iterator[str]:
        return iter(self._files)

    def __len__(self) -> int:
        return len(self._files)


def detect_boards(
    images: str | Path | Sequence[tuple[str, Path, Path]],
    board: AnyBoard,
    window: int = WINDOW,
    progress: Progress | None = None,
) -> BoardDetections:
    """Find a board in the photographs of a left and a right camera.

    Args:
        images: A folder (see `stereo_pairs`), or name, left path and right path of each view.
        window: Half side of the sub-pixel window [px].
        progress: Told how many images are done.

    Returns:
        The corners, in the same order in both cameras.

    Raises:
        DataError: If the images cannot be read or paired, those of a camera differ in size, or show
            no such board.
    """
    pairs = stereo_pairs(images) if isinstance(images, str | Path) else list(images)
    left = [(name, path) for name, path, _ in pairs]
    right = [(name, path) for name, _, path in pairs]
    return detect_boards_of_cameras({"left": left, "right": right}, board, window, progress)


def detect_boards_of_cameras(
    images: Mapping[str, Sequence[tuple[str, Path]]],
    board: AnyBoard,
    window: int = WINDOW,
    progress: Progress | None = None,
) -> BoardDetections:
    """Find a board in the photographs of any number of cameras.

    Args:
        images: Camera -> name of the view and path, as `camera_images` lists them. Photographs of
            different cameras with one name were taken at one time; cameras may miss views.
        window: Half side of the sub-pixel window [px].
        progress: Told how many images are done.

    Returns:
        The corners, in the same order in all cameras.

    Raises:
        DataError: If an image cannot be read, those of a camera differ in size, no image shows such
            a board, or none all of it.
    """
    files = {camera: dict(listed) for camera, listed in images.items()}
    names = _views_of(files)
    everything = [
        (camera, name, of_camera[name])
        for name in names
        for camera, of_camera in files.items()
        if name in of_camera
    ]
    paths = [path for _, _, path in everything]
    found, sizes = _find(paths, board, window, progress)
    pixels = np.full((len(names), len(board.points), len(files), 2), np.nan)
    columns, rows = list(files), {name: k for k, name in enumerate(names)}
    loose = np.zeros((len(names), len(files)), dtype=bool)
    for (camera, name, _), item in zip(everything, found, strict=True):
        if isinstance(item, NotSeen):
            continue
        v, c, corners = rows[name], columns.index(camera), item.corners
        firm = np.isfinite(pixels[v]).any(axis=(0, 2)) & ~loose[v]
        if firm.any() and not item.loose:
            corners = board.same_order(pixels[v, :, np.argmax(firm)], corners)
        pixels[v, :, c], loose[v, c] = corners, item.loose
    flat = pixels.reshape(len(names), len(board.points), -1)
    by_camera_size = [_size_of(camera, of_camera, sizes) for camera, of_camera in files.items()]
    views = BoardViews(board.points, names, tuple(files), flat, tuple(by_camera_size), loose)
    by_camera = {
        camera: {name: of_camera[name] for name in names if name in of_camera}
        for camera, of_camera in files.items()
    }
    return BoardDetections(board, views, by_camera, window, _not_seen(paths, found))


def _without_copies(views: BoardViews) -> BoardViews:
    """Leave out views in which all cameras saw what they saw before, to the last digit.

    No two photographs have the same noise; a copy would count as evidence, and as held out.
    """
    corners = np.nan_to_num(views.pixels.reshape(len(views), -1), nan=-1.0)
    _, first, same = np.unique(corners, axis=0, return_index=True, return_inverse=True)
    lead = first[same.reshape(len(views))]
    new = lead == np.arange(len(views))
    if not new.all():
        pairs = [f"{views.names[v]} of {views.names[lead[v]]}" for v in np.flatnonzero(~new)]
        warnings.warn(f"copies of photographs are left out: {listed(pairs)}", stacklevel=3)
    return views.select(new)


def _views_of(files: Mapping[str, Mapping[str, Path]]) -> tuple[str, ...]:
    """Return the names of all views, view 2 before view 10 where no camera has all."""
    first = next(iter(files.values()), {})
    every = dict.fromkeys(name for of_camera in files.values() for name in of_camera)
    if len(every) == len(first):
        return tuple(first)
    return tuple(sorted(every, key=lambda name: natural_key(Path(name))))


def _labels(files: Iterable[Path]) -> dict[Path, str]:
    """Return what photographs are called: their names, with as many folders as tell them apart."""
    every = set(files)
    for length in range(1, max((len(path.parts) for path in every), default=0)):
        labels = {path: "/".join(path.parts[-length:]) for path in every}
        if len(set(labels.values())) == len(every):
            return labels
    return {path: path.as_posix() for path in every}


def _find(
    files: Sequence[Path], board: AnyBoard, window: int, progress: Progress | None
) -> tuple[list[BoardDetection | NotSeen], dict[Path, tuple[int, int]]]:
    """Return what was found in each image, and width and height of all."""
    if not files:
        raise DataError("no images were given")
    found: list[BoardDetection | NotSeen] = []
    sizes: dict[Path, tuple[int, int]] = {}
    for done, path in enumerate(files, start=1):
        image = read_image(path)
        sizes[path] = (image.shape[1], image.shape[0])
        with looking_at(path):
            found.append(board.find(image, window))
        if progress:
            progress("looking for boards", done, len(files))
    for path, item in zip(files, found, strict=True):
        if isinstance(item, OtherBoard):
            raise DataError(f"{path}: {item.reason}")
    detections = [item for item in found if isinstance(item, BoardDetection)]
    if not detections:
        raise DataError(_no_board(files, board, _not_seen(files, found)))
    if all(item.loose for item in detections):
        raise DataError(_never_whole(files, detections))
    _warn_of_small_squares(detections, window)
    return found, sizes


def _size_of(
    camera: str, files: Mapping[str, Path], sizes: Mapping[Path, tuple[int, int]]
) -> tuple[int, int]:
    """Return width and height of a camera's images.

    Raises:
        DataError: If they differ.
    """
    different: dict[tuple[int, int], Path] = {}
    for path in files.values():
        different.setdefault(sizes[path], path)
    if len(different) > 1:
        seen = listed(f"{path.name} has {w}x{h}" for (w, h), path in different.items())
        folder = next(iter(files.values())).parent
        raise DataError(f"{folder}: images of {camera!r} have different sizes: {seen} pixels")
    return next(iter(different))


def _not_seen(files: Sequence[Path], found: Sequence[BoardDetection | NotSeen]) -> dict[str, str]:
    pairs, labels = zip(files, found, strict=True), _labels(files)
    return {labels[path]: item.reason for path, item in pairs if isinstance(item, NotSeen)}


def _never_whole(files: Sequence[Path], parts: Sequence[BoardDetection]) -> str:
    """Say how large the parts are of a board that no image shows whole."""
    sizes = Counter(tuple(sorted(_extent(part), reverse=True)) for part in parts)
    columns, rows = max(sizes, key=lambda size: (sizes[size], size))
    seen = {f"{long}x{short}": count for (long, short), count in sizes.most_common()}
    return (
        f"{files[0].parent}: none of {len(files)} images shows all of a {parts[0].board} board; "
        f"{listed(seen, most=4)} corners are seen of it: is it a {columns}x{rows} "
        "board (the size counts inner corners: 10x7 squares have 9x6)?"
    )


def _extent(part: BoardDetection) -> tuple[int, int]:
    """Return columns and rows of the corners that are seen of a chessboard."""
    columns, rows = np.ptp(lattice_of(part.board.points)[0][part.seen], axis=0) + 1
    return int(columns), int(rows)


def _no_board(files: Sequence[Path], board: AnyBoard, tried: dict[str, str]) -> str:
    """Say in which images what was tried, and which board may have been meant."""
    guesses = []
    for path in files[:_IMAGES_FOR_A_HINT]:
        with looking_at(path):
            guesses.append(size_of_board(read_image(path)))
    sizes = Counter(guess for guess in guesses if guess)
    named = listed((path.name for path in files), most=6)
    reason, _ = Counter(tried.values()).most_common(1)[0]
    nothing = (
        f"{files[0].parent}: no {board} board in any of {len(files)} images ({named}): {reason}"
    )
    if not isinstance(board, Board):
        return nothing
    hint = "the size counts inner corners: 10x7 squares have 9x6"
    if sizes:
        (columns, rows), _ = sizes.most_common(1)[0]
        hint = f"a {columns}x{rows} board seems to be there ({hint})"
    return f"{nothing}; {hint}"


def _warn_of_small_squares(detections: Sequence[BoardDetection], window: int) -> None:
    refined = [item.smallest_square_px for item in detections if item.window is not None]
    small = [size for size in refined if window > _WIDEST_WINDOW * size]
    if small:
        warnings.warn(
            f"squares are as small as {min(small):.0f} px in {len(small)} images, and the sub-pixel"
            f" window of {window} px nearly sees neighbouring corners: take a smaller window",
            stacklevel=4,
        )
