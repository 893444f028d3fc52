"""`nico-selfmodel calibrate cameras`: learn a rig of any number of cameras from a board."""

from pathlib import Path
from typing import Annotated

import typer

from nico_selfmodel.cli import inputs, options
from nico_selfmodel.cli.calibrate.camera_task import CameraTask, lens_options


def cameras(
    board: options.Board,
    square_mm: options.SquareMm,
    out: options.Out,
    images: Annotated[
        Path | None, typer.Argument(help="Folder with a folder of photographs for each camera.")
    ] = None,
    of_camera: Annotated[
        list[str] | None,
        typer.Option("--images", help="NAME=PATTERN of a camera's, as front='cam0/*.png'."),
    ] = None,
    tag_mm: options.TagMm = None,
    family: options.Family = None,
    window: options.Window = 11,
    lens: options.Lens = "auto",
    known: options.KnownCameras = None,
    fix: options.Fix = None,
    free: options.Free = None,
    prior: options.Prior = None,
    tangential: options.Tangential = False,
    fixed_aspect: options.FixedAspect = False,
    loss: options.Loss = "trimmed",
    test_fraction: options.TestFraction = None,
    seed: options.SplitSeed = 0,
    name: options.ModelName = None,
    require_test_px: options.RequireTestPx = None,
    no_report: options.NoReport = False,
    force: options.Force = False,
    as_json: options.AsJson = False,
) -> None:
    """Learn a rig of cameras from photographs of a board.

    Two cameras or more see the board at once.
    """
    from nico_selfmodel.vision.boards.board_images import images_by_folder, images_by_name

    if (images is None) == (not of_camera):
        raise ValueError("give a folder with a folder for each camera, or --images NAME=PATTERN")
    listed = images_by_name(of_camera or ()) if images is None else images_by_folder(images)
    folder = next(iter(listed.values()))[0][1].parent if images is None else images
    CameraTask(
        *(listed, folder),
        *(inputs.board(board, square_mm, tag_mm, family), window),
        lens_options(fix, free, prior, tangential, fixed_aspect, loss, lens),
        *(known, test_fraction, seed, name, require_test_px, no_report),
    ).run(out, force=force, as_json=as_json)
