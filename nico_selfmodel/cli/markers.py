"""`nico-selfmodel markers`: fiducial markers and boards to print."""

from typing import Annotated

import typer

from nico_selfmodel.cli import option_groups as groups
from nico_selfmodel.cli import options, printer


def sheet(
    out: options.OutFile,
    ids: Annotated[str, typer.Option("--ids", help="Which markers: 0-11 or 0,3,7.")] = "0-11",
    size_mm: Annotated[
        float, typer.Option("--size-mm", help="Side of a marker's black square.")
    ] = 30.0,
    family: options.Family = None,
    paper: Annotated[str, typer.Option("--paper", help="a4, letter, a3, a2, a1 or a0.")] = "a4",
    force: options.Force = False,
) -> None:
    """Print a sheet of markers, with cut lines and a ruler.

    As .pdf, .svg or .png.
    """
    from nico_selfmodel.files.whole import refuse_existing
    from nico_selfmodel.vision.markers.fiducial_family import DEFAULT_FAMILY
    from nico_selfmodel.vision.markers.marker_sheet import MarkerSheet, parse_ids

    refuse_existing(out, force=force)
    made = MarkerSheet(parse_ids(ids), size_mm, family or DEFAULT_FAMILY, paper)
    made.save(out)
    pages = len(made.pages)
    printer.line(
        f"{out}: {len(made.ids)} markers of {made.family}, {size_mm:g} mm,"
        f" {pages} page{'s' if pages > 1 else ''}; print at 100 % and measure the ruler"
    )


def board(
    out: options.OutFile,
    board: groups.BoardChoice,
    paper: Annotated[str, typer.Option("--paper", help="a4, letter, a3, a2, a1 or a0.")] = "a4",
    force: options.Force = False,
) -> None:
    """Print a board for cameras, with a ruler.

    As .pdf, .svg or .png.
    """
    from nico_selfmodel.files.whole import refuse_existing
    from nico_selfmodel.vision.boards.board_sheet import BoardSheet

    refuse_existing(out, force=force)
    made = BoardSheet(board.load(), paper)
    made.save(out)
    printer.line(f"{out}: {made.words}; print at 100 % and measure the ruler")
