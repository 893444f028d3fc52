"""`nico-selfmodel calibrate cameras`: learn a rig of any number of cameras from a board."""

from pathlib import Path
from typing import Annotated

import typer

from nico_selfmodel.cli import option_groups as groups
from nico_selfmodel.cli import options
from nico_selfmodel.cli.calibrate.camera_task import CameraTask


def cameras(
    board: groups.BoardChoice,
    output: groups.NamedOutput,
    lens: groups.LensChoice,
    held_out: groups.HeldOutShare,
    images: Annotated[
        Path | None, typer.Argument(help="Folder with a folder of photographs for each camera.")
    ] = None,
    of_camera: Annotated[
        list[str] | None,
        typer.Option("--images", help="NAME=PATTERN of a camera's, as front='cam0/*.png'."),
    ] = None,
    window: options.Window = 11,
    require_test_px: options.RequireTestPx = None,
) -> None:
    """Learn a camera, or a rig of them, from photographs of a board.

    Of several cameras two or more see the board at once.
    """
    from nico_selfmodel.vision.boards.board_images import images_by_folder, images_by_name

    if (images is None) == (not of_camera):
        raise ValueError("give a folder with a folder for each camera, or --images NAME=PATTERN")
    listed = images_by_name(of_camera or ()) if images is None else images_by_folder(images)
    folder = next(iter(listed.values()))[0][1].parent if images is None else images
    task = CameraTask(listed, folder, board, window, lens, held_out, require_test_px, output)
    task.run()
