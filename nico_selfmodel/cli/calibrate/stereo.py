"""`nico-selfmodel calibrate stereo`: learn a pair of cameras from a board."""

from pathlib import Path
from typing import Annotated

import typer

from nico_selfmodel.cli import option_groups as groups
from nico_selfmodel.cli import options
from nico_selfmodel.cli.calibrate.camera_task import CameraTask


def stereo(
    board: groups.BoardChoice,
    output: groups.NamedOutput,
    lens: groups.LensChoice,
    held_out: groups.HeldOutShare,
    images: options.ImagesOrNone = None,
    left: Annotated[
        str | None, typer.Option("--left", help="Its photographs by a pattern, as 'cam0/*.png'.")
    ] = None,
    right: Annotated[
        str | None, typer.Option("--right", help="The same of the right camera, 'cam1/*.png'.")
    ] = None,
    window: options.Window = 11,
    require_test_px: options.RequireTestPx = None,
    swap_cameras: Annotated[
        bool, typer.Option("--swap-cameras", help="Take left* for the right camera's, and so on.")
    ] = False,
) -> None:
    """Learn a pair of cameras from photographs of a board.

    In a folder they are called left* and right*, and paired by what follows.
    """
    pairs, folder = _pairs(images, left, right)
    if swap_cameras:
        pairs = [(view, right, left) for view, left, right in pairs]
    of_left = [(view, path) for view, path, _ in pairs]
    of_right = [(view, path) for view, _, path in pairs]
    task = CameraTask(
        {"left": of_left, "right": of_right},
        folder,
        board,
        window,
        lens,
        held_out,
        require_test_px,
        output,
    )
    task.run()


def _pairs(
    images: Path | None, left: str | None, right: str | None
) -> tuple[list[tuple[str, Path, Path]], Path]:
    """Return name, left and right photograph of each view, and the folder that they are called by.

    Raises:
        ValueError: If neither a folder nor two patterns are given, or both.
    """
    from nico_selfmodel.vision.boards.board_images import pairs_by_pattern, stereo_pairs

    if images is not None and left is None and right is None:
        return stereo_pairs(images), images
    if images is not None or left is None or right is None:
        raise ValueError("give a folder of photographs, or --left and --right patterns")
    pairs = pairs_by_pattern(left, right)
    return pairs, pairs[0][1].parent
