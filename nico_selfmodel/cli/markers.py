"""`nico-selfmodel markers`: fiducial markers to print."""

from pathlib import Path
from typing import Annotated

import typer

from nico_selfmodel.cli import console

app = typer.Typer(help="Fiducial markers to print.", no_args_is_help=True)


@app.callback()
def _describe() -> None:
    """Fiducial markers to print."""


@app.command("sheet")
def sheet(
    out: Annotated[Path, typer.Option("--out", help="File to make: .pdf, .svg or .png.")],
    ids: Annotated[str, typer.Option("--ids", help="Which markers: 0-11 or 0,3,7.")] = "0-11",
    size_mm: Annotated[
        float, typer.Option("--size-mm", help="Side of a marker's black square.")
    ] = 30.0,
    family: Annotated[str, typer.Option("--family", help="Of the markers.")] = "apriltag_36h11",
    paper: Annotated[str, typer.Option("--paper", help="a4 or letter.")] = "a4",
    force: Annotated[bool, typer.Option("--force", help="Replace an existing file.")] = False,
) -> None:
    """Write a sheet of markers with cut lines and a ruler to check the printer with."""
    from nico_selfmodel.files import refuse_existing
    from nico_selfmodel.vision.marker_sheet import MarkerSheet, parse_ids

    refuse_existing(out, force=force)
    made = MarkerSheet(parse_ids(ids), size_mm, family, paper)
    made.save(out)
    pages = len(made.pages)
    console.out.print(
        f"{out}: {len(made.ids)} markers of {family}, {size_mm:g} mm,"
        f" {pages} page{'s' if pages > 1 else ''}; print at 100 % and measure the ruler",
        markup=False,
    )
