"""`nico-selfmodel calibrate camera`: learn one camera alone from a board."""

import glob
from pathlib import Path
from typing import Annotated

import typer

from nico_selfmodel.cli import inputs, options
from nico_selfmodel.cli.calibrate.camera_task import CameraTask, lens_options


def camera(
    images: Annotated[
        str, typer.Argument(help="Folder of photographs of a board, or a pattern: 'cam0/*.png'.")
    ],
    board: options.Board,
    square_mm: options.SquareMm,
    out: options.Out,
    camera: Annotated[
        str, typer.Option("--camera", help="What it is called, and how names in a folder begin.")
    ] = "left",
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
    """Learn one camera alone from photographs of a board."""
    from nico_selfmodel.names import check_name
    from nico_selfmodel.vision.boards.board_images import camera_images, images_by_pattern

    check_name(camera, "--camera")
    by_pattern = glob.has_magic(images)
    listed = images_by_pattern(images) if by_pattern else camera_images(images, camera)
    folder = listed[0][1].parent if by_pattern else Path(images)
    CameraTask(
        *({camera: listed}, folder),
        *(inputs.board(board, square_mm, tag_mm, family), window),
        lens_options(fix, free, prior, tangential, fixed_aspect, loss, lens),
        *(known, test_fraction, seed, name, require_test_px, no_report),
    ).run(out, force=force, as_json=as_json)
