"""`nico-selfmodel predict`: encoders in, hand position with sigma out."""

import csv
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from nico_selfmodel.cli import options, printer
from nico_selfmodel.names import listed

if TYPE_CHECKING:
    from numpy.typing import NDArray


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
        typer.Option(
            "--table",
            help="CSV with a column per joint, approach.<joint> if known; - reads standard input.",
        ),
    ] = None,
    marker: options.Marker = None,
    frame: Annotated[
        str | None,
        typer.Option(
            "--frame",
            metavar="SENSOR",
            help="Of a whole body: the sensor in whose frame places are told, such as the tracker.",
        ),
    ] = None,
    as_json: options.AsJson = False,
) -> None:
    """Predict where the hand is: x, y, z [m] with sigmas [mm].

    One sigma is that of the model, the other counts noise too; each is that of one coordinate, rms
    of the three. Places are in the frame that the output names: of an arm that of its tracker or
    left camera, of a whole body where it begins, which with --robot is the description's root;
    --frame SENSOR tells them as that sensor sees them.
    """
    from nico_selfmodel.dataset.readings import warn_beyond
    from nico_selfmodel.model.self_model_file import load_model
    from nico_selfmodel.model.tree.body_model import is_body

    if is_body(model):
        _predict_body(model, encoders, table, marker, frame, as_json)
        return
    if frame is not None:
        raise ValueError(f"--frame is for whole bodies; {model} is of one arm: leave it out")
    learned = load_model(model)
    if (encoders is None) == (table is None):
        raise ValueError(
            f"give --encoders or --table; the joints are {listed(learned.joints)}, in "
            f"{', '.join(learned.servos.unit)}"
        )
    readings, approach = _readings(encoders, table, learned.joints)
    prediction = learned.predict(readings, marker, approach)
    warn_beyond(readings, learned.joints, learned.fit.get("readings", {}))
    frame = "left camera" if learned.cameras else "tracker"
    sigma, total = prediction.sigma, prediction.total_sigma
    rows = [
        {
            "x_m": float(p[0]),
            "y_m": float(p[1]),
            "z_m": float(p[2]),
            "sigma_mm": None if sigma is None else 1e3 * float(sigma[k]),
            "sigma_with_noise_mm": None if total is None else 1e3 * float(total[k]),
            "frame": frame,
        }
        for k, p in enumerate(prediction.p_WH)
    ]
    if as_json:
        printer.as_json({"marker": marker or learned.markers[0], "poses": rows})
        return
    writer = csv.DictWriter(sys.stdout, list(rows[0]), lineterminator="\n")
    writer.writeheader()
    writer.writerows(rows)


def _readings(
    encoders: list[str] | None, table: Path | None, joints: tuple[str, ...]
) -> tuple["NDArray", "NDArray | None"]:
    """Return readings, and from which sides joints came where a table tells. Shape (N, n) each."""
    from nico_selfmodel.dataset.csv_table import CsvTable
    from nico_selfmodel.dataset.readings import (
        approach_from_table,
        readings_from_table,
        readings_from_words,
    )
    from nico_selfmodel.files.reading import LARGEST_TABLE, read_standard_input

    if table is None:
        return readings_from_words(encoders or [], joints), None
    if str(table) == "-":
        read = CsvTable.of_text(read_standard_input(LARGEST_TABLE), Path("standard input"))
    else:
        read = CsvTable.read(table)
    return readings_from_table(read, joints), approach_from_table(read, joints)


def _predict_body(
    model: Path,
    encoders: list[str] | None,
    table: Path | None,
    marker: str | None,
    frame: str | None,
    as_json: bool,
) -> None:
    """Predict the markers of any body: places, orientations, sigma, pixels by camera and mirror."""
    import numpy as np

    from nico_selfmodel.estimation.tree.body_prediction import predict_body
    from nico_selfmodel.geometry.rotation import rotation_vectors_of
    from nico_selfmodel.model.tree.body_model import load_body

    body = load_body(model)
    tree = body.tree
    chosen = range(len(tree.markers)) if marker is None else [tree.marker_index(marker)]
    read = [i for i in range(len(tree.joints)) if tree.coupling[i, i]]
    if (encoders is None) == (table is None):
        raise ValueError(f"give --encoders or --table; the joints are {listed(tree.joints)}")
    given, side = _readings(encoders, table, tuple(tree.joints[i] for i in read))
    readings = np.full((len(given), len(tree.joints)), np.nan)
    readings[:, read] = given
    approach = np.zeros(readings.shape)
    approach[:, read] = 0.0 if side is None else side
    found = predict_body(body, readings, approach, frame)
    turns = rotation_vectors_of(found.R_FM)
    images = found.pixels | {f"{c}_in_{m}": uv for (c, m), uv in found.reflected.items()}
    rows, told_in = [], frame or str(body.provenance.get("world", "world"))
    for k in range(len(readings)):
        for m in chosen:
            place = dict(zip(("x_m", "y_m", "z_m"), found.p_FM[k, m].tolist(), strict=True))
            turn = dict(zip(("rx", "ry", "rz"), turns[k, m].tolist(), strict=True))
            seen = {
                f"{name}_{axis}": None if np.isnan(value) else float(value)
                for name, pixels in images.items()
                for axis, value in zip("uv", pixels[k, m], strict=True)
            }
            sigma = {"sigma_mm": 1e3 * float(found.sigma[k, m])}
            rows.append(
                {"pose": k, "marker": tree.markers[m].name}
                | {**place, **turn, **sigma, **seen, "frame": told_in}
            )
    if as_json:
        printer.as_json({"markers": rows})
        return
    writer = csv.DictWriter(sys.stdout, list(rows[0]), lineterminator="\n")
    writer.writeheader()
    writer.writerows(rows)
