"""`nico-selfmodel calibrate camera`: learn one camera alone from a board."""

import glob
from pathlib import Path
from typing import Annotated

import typer

from nico_selfmodel.cli import option_groups as groups
from nico_selfmodel.cli import options
from nico_selfmodel.cli.calibrate.camera_task import CameraTask


def camera(
    images: Annotated[
        str, typer.Argument(help="Folder of photographs of a board, or a pattern: 'cam0/*.png'.")
    ],
    board: groups.BoardChoice,
    output: groups.NamedOutput,
    lens: groups.LensChoice,
    held_out: groups.HeldOutShare,
    camera: Annotated[
        str,
        typer.Option("--camera", help="What it is called; only photographs that begin so, if any."),
    ] = "left",
    window: options.Window = 11,
    require_test_px: options.RequireTestPx = None,
) -> None:
    """Learn one camera alone from photographs of a board."""
    from nico_selfmodel.names import check_name
    from nico_selfmodel.vision.boards.board_images import images_by_pattern, images_of_one

    check_name(camera, "--camera")
    by_pattern = glob.has_magic(images)
    listed = images_by_pattern(images) if by_pattern else images_of_one(images, camera)
    folder = listed[0][1].parent if by_pattern else Path(images)
    task = CameraTask(
        {camera: listed}, folder, board, window, lens, held_out, require_test_px, output
    )
    task.run()
