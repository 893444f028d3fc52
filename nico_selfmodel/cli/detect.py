"""`nico-selfmodel detect`: find markers, colours or boards in photographs."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from nico_selfmodel.cli import options, printer
from nico_selfmodel.cli.option_groups import BoardChoice

if TYPE_CHECKING:
    from nico_selfmodel.vision.detections import Detector


def detect(
    images: Annotated[list[Path], typer.Argument(help="Photographs, or folders of them.")],
    out: options.Out,
    fiducial: Annotated[
        bool, typer.Option("--fiducial", help="Look for markers, in a mirror too.")
    ] = False,
    color: Annotated[
        Path | None, typer.Option("--color", help="Look for a colour; YAML of pick-color.")
    ] = None,
    board: options.BoardOrNone = None,
    family: options.Family = None,
    window: options.WindowOrNone = None,
    force: options.Force = False,
    as_json: options.AsJson = False,
) -> None:
    """Find markers, a colour or a board in photographs.

    Writes a table and annotated images. Ends with 1 if nothing was seen in any image.
    """
    from nico_selfmodel.files.whole import refuse_folder
    from nico_selfmodel.vision.detections import images_of, write_detections

    detector = _detector(fiducial, family, color, board, window)
    files = images_of(images)
    refuse_folder(out, force=force, inputs=[*files, color])
    with printer.progress_bar() as progress:
        document = write_detections(files, detector, out, force=force, progress=progress)
    if as_json:
        printer.as_json(document)
    else:
        _print(document, out)
    if not document["detections"]:
        raise typer.Exit(1)


def _detector(
    fiducial: bool,
    family: str | None,
    color: Path | None,
    board: str | None,
    window: int | None,
) -> "Detector":
    from nico_selfmodel.vision.boards.exact_corners import WINDOW
    from nico_selfmodel.vision.color.color_model import ColorModel
    from nico_selfmodel.vision.detections import Detector
    from nico_selfmodel.vision.markers.fiducial_family import DEFAULT_FAMILY

    if sum([fiducial, color is not None, board is not None]) != 1:
        raise ValueError("choose one of --fiducial, --color FILE and --board 9x6")
    if family is not None and color is not None:
        raise ValueError("--family is for --fiducial and boards of tags")
    if window is not None and board is None:
        raise ValueError("--window is for --board")
    if fiducial:
        return Detector.for_fiducials(family or DEFAULT_FAMILY)
    if color is not None:
        return Detector.for_color(ColorModel.load(color))
    # The size of a square does not matter here: no lengths come out.
    wanted = BoardChoice(board or "", 1.0, None, family).load()
    return Detector.for_board(wanted, window or WINDOW)


def _print(document: dict[str, Any], out: Path) -> None:
    for image, reason in document["not_seen"].items():
        printer.line(f"not seen in {image}: {reason}")
    seen, images = document["images_with_detections"], document["images"]
    printer.line(
        f"{document['detector']}: {document['detections']} seen in {seen} of {images} images\n"
        f"{out}/detections.csv, result.json and annotated images"
    )
