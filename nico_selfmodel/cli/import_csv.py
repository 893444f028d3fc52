"""`nico-selfmodel import csv`: a plain table, by a map of its columns."""

from pathlib import Path
from typing import Annotated

import typer

from nico_selfmodel.cli import inputs, options, printer


def from_csv(
    table: Annotated[Path, typer.Argument(help="The CSV file.")],
    columns: Annotated[Path, typer.Option("--map", help="YAML that says which column holds what.")],
    out: options.Out,
    name: options.DatasetName = None,
    force: options.Force = False,
) -> None:
    """Import a plain CSV by a column map."""
    from nico_selfmodel.dataset.folder import save_dataset
    from nico_selfmodel.dataset.importers.csv_importer import import_csv
    from nico_selfmodel.files.whole import refuse_existing

    refuse_existing(out, force=force, inputs=[table, columns])
    name = name or inputs.name_after(out)
    data = import_csv(table, columns, name=name)
    save_dataset(data, out, force=force)
    printer.dataset(data, out)
