"""`nico-selfmodel predict`: encoders in, hand position with sigma out."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from nico_selfmodel.cli import options, printer
from nico_selfmodel.cli.option_groups import OptionGroup
from nico_selfmodel.names import listed

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from nico_selfmodel.dataset.csv_table import CsvTable


@dataclass(frozen=True)
class Poses(OptionGroup):
    """Which poses to predict."""

    encoders: Annotated[
        list[str] | None,
        typer.Option(
            "--encoders",
            metavar="A,B,...",
            help="One pose: readings in the order of the joints. Repeat for more poses.",
        ),
    ] = None
    table: Annotated[
        Path | None,
        typer.Option(
            "--table",
            help="CSV with a column per joint, approach.<joint> if known; - reads standard input.",
        ),
    ] = None

    def load(self, joints: tuple[str, ...], units: Sequence[str]) -> "tuple[NDArray, NDArray]":
        """Return readings, and from which sides joints came, 0 where no table tells. (N, n) each.

        Raises:
            DataError: If the table is not one.
            ValueError: If readings are given in no way or in two, or are not one for each joint.
        """
        import numpy as np

        from nico_selfmodel.dataset.readings import (
            approach_from_table,
            readings_from_table,
            readings_from_words,
        )

        if (self.encoders is None) == (self.table is None):
            inside = f", in {listed(dict.fromkeys(units))}" if units else ""
            raise ValueError(
                f"give either --encoders or --table; the joints are {listed(joints)}{inside}"
            )
        if self.table is None:
            readings = readings_from_words(self.encoders or [], joints)
            return readings, np.zeros(readings.shape)
        read = _read(self.table)
        readings, approach = readings_from_table(read, joints), approach_from_table(read, joints)
        return readings, np.zeros(readings.shape) if approach is None else approach


def predict(
    model: options.Model,
    poses: Poses,
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

    One sigma is that of the model, the other counts noise too, of the joints of a whole body, of
    an arm that of what was measured; each is that of one coordinate, rms
    of the three. Places are in the frame that the output names: of an arm that of its tracker or
    left camera, of a whole body where it begins, which with --robot is the description's root;
    --frame SENSOR tells them as that sensor sees them, which is another frame once the sensor has
    moved and was learned anew (monitor --relearn).
    """
    from nico_selfmodel.model.tree.body_model import is_body

    if is_body(model):
        rows = _of_body(model, poses, marker, frame)
        document = {"markers": rows}
    elif frame is not None:
        raise ValueError(f"--frame is for whole bodies; {model} is of one arm: leave it out")
    else:
        marker, rows = _of_arm(model, poses, marker)
        document = {"marker": marker, "poses": rows}
    if as_json:
        printer.as_json(document)
        return
    from nico_selfmodel.files.csv_cells import rows_text

    print(rows_text(rows[0], (row.values() for row in rows)), end="")


def _read(table: Path) -> "CsvTable":
    """Return a table, or what is piped in."""
    from nico_selfmodel.dataset.csv_table import CsvTable
    from nico_selfmodel.files.reading import LARGEST_TABLE, read_standard_input

    if str(table) == "-":
        return CsvTable.of_text(read_standard_input(LARGEST_TABLE), Path("standard input"))
    return CsvTable.read(table)


def _of_arm(model: Path, poses: Poses, marker: str | None) -> tuple[str, list[dict[str, Any]]]:
    """Return which marker of an arm is predicted, and where it is, a row a pose."""
    from nico_selfmodel.dataset.readings import warn_beyond
    from nico_selfmodel.model.self_model_file import load_model

    learned = load_model(model)
    readings, approach = poses.load(learned.joints, learned.servos.unit)
    prediction = learned.predict(readings, marker, approach)
    warn_beyond(readings, learned.joints, learned.fit.get("readings", {}))
    frame = "left camera" if learned.cameras else "tracker"
    sigma, total = prediction.sigma, prediction.total_sigma
    rows = [
        {
            **dict(zip(("x_m", "y_m", "z_m"), p.tolist(), strict=True)),
            "sigma_mm": None if sigma is None else 1e3 * float(sigma[k]),
            "sigma_with_noise_mm": None if total is None else 1e3 * float(total[k]),
            "frame": frame,
        }
        for k, p in enumerate(prediction.p_WH)
    ]
    return marker or learned.markers[0], rows


def _of_body(
    model: Path, poses: Poses, marker: str | None, frame: str | None
) -> list[dict[str, Any]]:
    """Predict the markers of any body: places, orientations, sigma, pixels by camera and mirror."""
    import numpy as np

    from nico_selfmodel.estimation.tree.body_prediction import predict_body
    from nico_selfmodel.geometry.rotation import rotation_vectors_of
    from nico_selfmodel.model.tree.body_model import load_body

    body = load_body(model)
    tree = body.tree
    chosen = range(len(tree.markers)) if marker is None else [tree.marker_index(marker)]
    read = [i for i in range(len(tree.joints)) if tree.coupling[i, i]]
    given, side = poses.load(tuple(tree.joints[i] for i in read), ())
    readings = np.full((len(given), len(tree.joints)), np.nan)
    readings[:, read] = given
    approach = np.zeros(readings.shape)
    approach[:, read] = side
    found = predict_body(body, readings, approach, frame)
    turns = rotation_vectors_of(found.R_FM)
    images = found.pixels | {f"{c}_in_{m}": uv for (c, m), uv in found.reflected.items()}
    told_in = frame or body.world
    return [
        {
            "pose": k,
            "marker": tree.markers[m].name,
            **dict(zip(("x_m", "y_m", "z_m"), found.p_FM[k, m].tolist(), strict=True)),
            **dict(zip(("rx", "ry", "rz"), turns[k, m].tolist(), strict=True)),
            "sigma_mm": 1e3 * float(found.sigma[k, m]),
            "sigma_with_noise_mm": 1e3 * float(found.total_sigma[k, m]),
            **{
                f"{name}_{axis}": None if np.isnan(value) else float(value)
                for name, pixels in images.items()
                for axis, value in zip("uv", pixels[k, m], strict=True)
            },
            "frame": told_in,
        }
        for k in range(len(readings))
        for m in chosen
    ]
