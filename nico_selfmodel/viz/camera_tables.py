"""The tables of a camera report: plain rows of text, made from `result.json`."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from nico_selfmodel.estimation import CameraAssessment
from nico_selfmodel.model import SelfModel
from nico_selfmodel.model.camera import INTRINSICS
from nico_selfmodel.model.stereo_rig import EYES, POSE_NAMES
from nico_selfmodel.viz.document_tables import (
    HEADINGS,
    facts,
    parameter_table,
    statistics_cells,
    statistics_table,
)
from nico_selfmodel.viz.numbers_shown import decimals, signed
from nico_selfmodel.viz.report_tables import Cell, Table

_SHOWN = {"px": ("px", 1.0), "1": ("", 1.0), "m": ("mm", 1e3), "rad": ("deg", 180.0 / np.pi)}


def pixel_error_table(document: Mapping[str, Any]) -> Table | None:
    """Return statistics of every set of reprojection errors, the most telling first."""
    return statistics_table(document, "pixels", "reprojection error [px]", 3, "corners")


def pair_table(document: Mapping[str, Any]) -> Table | None:
    """Return what the eyes do together, None for one eye: epipolar and reconstruction errors."""
    rows = []
    if document.get("epipolar_px") is not None:
        errors = statistics_cells(document["epipolar_px"], "pixels", 3)[1:]
        rows.append(("distance from the epipolar line [px]", errors))
    found = document.get("reconstruction")
    if found is not None:
        rows.append(("rebuilt corners [mm]", statistics_cells(found, "position_mm", 2)[1:]))
    return Table(("", *HEADINGS), tuple(rows)) if rows else None


@dataclass(frozen=True)
class Tile:
    """A number that says much, in large letters."""

    number: str
    """With its unit."""
    what: str
    """What it is."""
    note: str
    """How to read it."""


def pair_tiles(document: Mapping[str, Any]) -> tuple[Tile, ...]:
    """Return the numbers by which pairs of eyes are compared; none for one eye."""
    tiles = []
    baseline = document["parameters"].get("baseline")
    if baseline is not None:
        length, sigma = 1e3 * baseline["value"], baseline["sigma"]
        known = "" if sigma is None else f" ± {decimals(1e3 * sigma, 1e3 * sigma)}"
        shown = decimals(length, None if sigma is None else 1e3 * sigma)
        tiles.append(Tile(f"{shown}{known} mm", "baseline", "from eye to eye"))
    if document.get("epipolar_px") is not None:
        mean = document["epipolar_px"]["pixels"]["mean"]
        note = f"mean in each image; OpenCV's sample adds both: {2 * mean:.3f} px"
        tiles.append(Tile(f"{mean:.3f} px", "off the epipolar line", note))
    found = document.get("reconstruction")
    if found is not None:
        boards = f"{found['boards']} {'held-out ' if found['held_out'] else ''}boards"
        edge, scale = found["edge_mm"], found["scale"]
        note = (
            f"of the rebuilt squares of {edge['true']:.4g} mm, {boards}; the thesis reports "
            "1.59 mm, with squares of 28 mm"
        )
        tiles.append(Tile(f"{edge['sd']:.2f} mm", "SD of edges", note))
        off, spread = 100.0 * (scale["mean"] - 1.0), 100.0 * scale["sd"]
        note = f"size of the rebuilt boards over the true one, SD {spread:.2f} %"
        tiles.append(Tile(f"{signed(off, 2)} %", "off in scale", note))
    return tuple(tiles)


def inside_table(document: Mapping[str, Any]) -> Table:
    """Return the intrinsic parameters, one eye a row."""
    parameters = document["parameters"]
    eyes = [eye for eye in EYES if f"{eye}.fx" in parameters]
    rows = tuple(
        (eye, tuple(_cell(f"{eye}.{what}", document) for what in INTRINSICS)) for eye in eyes
    )
    units = [" [px]"] * 5 + [""] * 5
    return Table(("eye", *(f"{n}{u}" for n, u in zip(INTRINSICS, units, strict=True))), rows)


def pose_table(document: Mapping[str, Any]) -> Table | None:
    """Return where the right eye is in the left one's frame, None for one eye."""
    if "baseline" not in document["parameters"]:
        return None
    cells = [_cell(f"right.pose.{what}", document) for what in POSE_NAMES]
    headings = ("", *(f"{n} [{'deg' if n[0] == 'r' else 'mm'}]" for n in POSE_NAMES))
    row = ("right eye in the left one's frame", (*cells, _cell("baseline", document)))
    return Table((*headings, "baseline [mm]"), (row,))


def camera_parameter_list(document: Mapping[str, Any]) -> Table:
    """Return every parameter in SI units and pixels, to the last digit."""
    return parameter_table(document, lambda name, _: _cell(name, document).kind)


def camera_provenance(
    assessment: CameraAssessment, document: Mapping[str, Any], model: SelfModel | None
) -> dict[str, str]:
    """Return what the calibration was made of and with."""
    calibration = assessment.calibration
    width, height = calibration.views.image_size
    found: dict[str, Any] = {}
    if model is not None:
        found |= {**model.provenance, **model.fit}
    detection = document.get("detection") or {}
    found |= {
        f"detection {key}": value
        for key, value in detection.items()
        if key not in ("files", "not_seen")
    }
    found["image size"] = f"{width} x {height} px"
    found["noise of a coordinate"] = _px(document["pixel_sigma_px"])
    found["steps of the solver"] = document["iterations"]
    found["seconds"] = f"{document['seconds']:.2f}"
    return facts(found)


def blind_names(document: Mapping[str, Any]) -> frozenset[str]:
    """Return the parameters in directions that the data do not determine."""
    lines: Iterable[str] = document["not_identifiable"]
    return frozenset(name for line in lines for name in line.split(", "))


def _cell(name: str, document: Mapping[str, Any]) -> Cell:
    """Return a parameter in the unit that people read, with its standard deviation."""
    entry = document["parameters"][name]
    value, sigma, factor = entry["value"], entry["sigma"], _SHOWN[entry["unit"]][1]
    derived = name == "baseline"
    if not entry["free"] and not derived:
        return Cell(f"{factor * value:g}".replace("-", "−"), "fixed", "fixed", value)
    sigma = None if sigma is None else factor * sigma
    shown = decimals(factor * value, sigma)
    note = "" if sigma is None else f"± {decimals(sigma, sigma)}"
    if name in blind_names(document):
        return Cell(shown, f"blind {note}".strip(), "blind", value)
    return Cell(shown, note, "derived" if derived else "free", value)


def _px(value: float | None) -> str:
    return "not known" if value is None else f"{value:.3f} px"
