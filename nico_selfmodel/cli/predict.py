"""`nico-selfmodel predict`: encoders in, hand position with sigma out."""

import csv
import sys
from pathlib import Path
from typing import Annotated

import typer

from nico_selfmodel.cli import options, printer
from nico_selfmodel.names import listed


def predict(
    model: options.Model,
    encoders: Annotated[
        list[str] | None,
        typer.Option(
            "--encoders",
            metavar="A,B,...",
            help="One pose: readings in the order of the joints. Repeat for more poses.",
        ),
    ] = None,
    table: Annotated[
        Path | None,
        typer.Option("--table", help="CSV with a column per joint; - reads standard input."),
    ] = None,
    marker: options.Marker = None,
    as_json: options.AsJson = False,
) -> None:
    """Predict where the hand is: x, y, z [m], sigma of the model and with noise [mm]."""
    from nico_selfmodel.files.reading import LARGEST_TABLE, read_standard_input, read_text
    from nico_selfmodel.model.readings import (
        readings_from_table,
        readings_from_words,
        warn_beyond,
    )
    from nico_selfmodel.model.self_model_file import load_model

    learned = load_model(model)
    if (encoders is None) == (table is None):
        raise ValueError(
            f"give --encoders or --table; the joints are {listed(learned.joints)}, in "
            f"{', '.join(learned.servos.unit)}"
        )
    if table is None:
        readings = readings_from_words(encoders or [], learned.joints)
    else:
        piped = str(table) == "-"
        text = read_standard_input(LARGEST_TABLE) if piped else read_text(table, LARGEST_TABLE)
        where = "standard input" if piped else str(table)
        readings = readings_from_table(text, learned.joints, where)
    prediction = learned.predict(readings, marker)
    warn_beyond(readings, learned.joints, learned.fit.get("readings", {}))
    sigma, total = prediction.sigma, prediction.total_sigma
    rows = [
        {
            "x_m": float(p[0]),
            "y_m": float(p[1]),
            "z_m": float(p[2]),
            "sigma_mm": None if sigma is None else 1e3 * float(sigma[k]),
            "sigma_with_noise_mm": None if total is None else 1e3 * float(total[k]),
        }
        for k, p in enumerate(prediction.p_WH)
    ]
    if as_json:
        printer.as_json({"marker": marker or learned.markers[0], "poses": rows})
        return
    writer = csv.DictWriter(sys.stdout, list(rows[0]), lineterminator="\n")
    writer.writeheader()
    writer.writerows(rows)
