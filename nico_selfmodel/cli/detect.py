"""`nico-selfmodel detect`: find markers, colours or chessboards in photographs."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from nico_selfmodel.cli import console

if TYPE_CHECKING:
    from nico_selfmodel.vision.detections import Detector


def detect(
    images: Annotated[list[Path], typer.Argument(help="Photographs, or folders of them.")],
    out: Annotated[Path, typer.Option("--out", help="Folder to make.")],
    fiducial: Annotated[
        bool, typer.Option("--fiducial", help="Look for markers, in a mirror too.")
    ] = False,
    color: Annotated[
        Path | None, typer.Option("--color", help="Look for a colour; YAML of pick-color.")
    ] = None,
    chessboard: Annotated[
        str | None, typer.Option("--chessboard", help="Look for a board: inner corners, 9x6.")
    ] = None,
    family: Annotated[
        str | None, typer.Option("--family", help="Of the markers; apriltag_36h11 by default.")
    ] = None,
    window: Annotated[
        int | None,
        typer.Option("--window", min=1, help="Half side of a board's sub-pixel window [px]; 11."),
    ] = None,
    force: Annotated[bool, typer.Option("--force", help="Replace an earlier result.")] = False,
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON.")] = False,
) -> None:
    """Find markers, a colour or a chessboard; write a table and annotated images.

    Ends with 1 if nothing was seen in any image.
    """
    from nico_selfmodel.files import refuse_folder
    from nico_selfmodel.vision.detections import images_of, write_detections

    detector = _detector(fiducial, family, color, chessboard, window)
    files = images_of(images)
    refuse_folder(out, force=force, inputs=[*files, color])
    with console.progress_bar() as stage:
        document = write_detections(files, detector, out, force=force, progress=stage)
    if as_json:
        console.print_json(document)
    else:
        _print(document, out)
    if not document["detections"]:
        raise typer.Exit(1)


def _detector(
    fiducial: bool,
    family: str | None,
    color: Path | None,
    chessboard: str | None,
    window: int | None,
) -> "Detector":
    from nico_selfmodel.vision import WINDOW, Board, ColorModel
    from nico_selfmodel.vision.detections import Detector
    from nico_selfmodel.vision.fiducial_family import DEFAULT_FAMILY

    if sum([fiducial, color is not None, chessboard is not None]) != 1:
        raise ValueError("choose one of --fiducial, --color FILE and --chessboard 9x6")
    if family is not None and not fiducial:
        raise ValueError("--family is for --fiducial")
    if window is not None and chessboard is None:
        raise ValueError("--window is for --chessboard")
    if fiducial:
        return Detector.for_fiducials(family or DEFAULT_FAMILY)
    if color is not None:
        return Detector.for_color(ColorModel.load(color))
    # The size of a square does not matter here: no lengths come out.
    board = Board.parse(chessboard or "", square_mm=1.0)
    return Detector.for_chessboard(board, window or WINDOW)


def _print(document: dict[str, Any], out: Path) -> None:
    for image, reason in document["not_seen"].items():
        console.out.print(f"not seen in {image}: {reason}", markup=False)
    seen, images = document["images_with_detections"], document["images"]
    console.out.print(
        f"{document['detector']}: {document['detections']} seen in {seen} of {images} images",
        markup=False,
    )
    console.out.print(f"{out}/detections.csv, result.json and annotated images", markup=False)
