"""The tables of the report: plain rows of text, made from `result.json` and the calibration."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from nico_selfmodel.estimation import KinematicCalibration
from nico_selfmodel.viz.arm_shape import arm_length
from nico_selfmodel.viz.blind_parameters import blind_parameters
from nico_selfmodel.viz.numbers_shown import decimals

_SHOWN = {"m": ("mm", 1e3), "rad": ("deg", 180.0 / np.pi), "1": ("", 1.0)}
SETS = (("test", "held-out"), ("cross_validation", "cross-validation"), ("train", "training"))
STATISTICS = ("mean", "sd", "rms", "median", "p95", "max")
_JOINT_COLUMNS = ("D", "theta_offset", "r", "alpha", "beta", "gear")


@dataclass(frozen=True)
class Cell:
    """A number as it is shown, beside what it is exactly."""

    text: str
    """For people."""
    note: str = ""
    """Its standard deviation, or why it has none."""
    kind: str = ""
    """`free`, `fixed`, `blind` or `unknown`; empty where it is no parameter."""
    value: float | None = None
    """As in `result.json`."""


@dataclass(frozen=True)
class Table:
    """Rows under headings; the first cell of each row names it."""

    headings: tuple[str, ...]
    rows: tuple[tuple[str, tuple[Cell, ...]], ...]


def error_table(document: Mapping[str, Any], arm: float) -> Table:
    """Return statistics of every set of errors, the most telling first.

    Args:
        document: Content of `result.json`.
        arm: Length of the arm [m].
    """
    rows = []
    for key, label in SETS:
        block = document[key]
        if block is not None:
            statistics = block["position_mm"]
            cells = [Cell(str(block["n"]), value=block["n"])]
            cells += [Cell(f"{statistics[s]:.2f}", value=statistics[s]) for s in STATISTICS]
            cells.append(Cell(f"{statistics['mean'] / (1e3 * arm):.4f}"))
            rows.append((label, tuple(cells)))
    headings = ("error [mm]", "points", "mean", "SD", "rms", "median", "95 %", "max", "mean / arm")
    return Table(headings, tuple(rows))


def joint_table(calibration: KinematicCalibration, document: Mapping[str, Any]) -> Table:
    """Return the Denavit-Hartenberg rows and gears, one joint a row."""
    parameters = document["parameters"]
    joints = calibration.model.joints
    twisted = any(f"{joint}.beta" in parameters for joint in joints)
    parts = [part for part in _JOINT_COLUMNS if part != "beta" or twisted]
    rows = tuple(
        (joint, tuple(_parameter_cell(calibration, f"{joint}.{p}", parameters) for p in parts))
        for joint in joints
    )
    titles = {
        "D": "D [mm]",
        "theta_offset": "θ offset [deg]",
        "r": "r [mm]",
        "alpha": "α [deg]",
        "beta": "β [deg]",
        "gear": "gear",
    }
    return Table(("joint", *(titles[part] for part in parts)), rows)


def place_table(calibration: KinematicCalibration, document: Mapping[str, Any]) -> Table:
    """Return where the chain begins in the measuring frame, and the points on the hand."""
    parameters = document["parameters"]

    def row(label: str, prefix: str, parts: tuple[str, ...]) -> tuple[str, tuple[Cell, ...]]:
        names = (f"{prefix}.{part}" for part in parts)
        cells = tuple(_parameter_cell(calibration, name, parameters) for name in names)
        return label, cells + (Cell(""),) * (6 - len(cells))

    rows = [row("M0: frame 0 in the measuring frame", "M0", ("x", "y", "z", "rx", "ry", "rz"))]
    for marker in calibration.model.markers:
        label = f"{marker}: point in the last frame"
        rows.append(row(label, f"hand.{marker}", ("x", "y", "z")))
    headings = ("", "x [mm]", "y [mm]", "z [mm]", "rx [deg]", "ry [deg]", "rz [deg]")
    return Table(headings, tuple(rows))


def parameter_list(calibration: KinematicCalibration, document: Mapping[str, Any]) -> Table:
    """Return every parameter in SI units, to the last digit."""
    rows = []
    for name, entry in document["parameters"].items():
        shown = _parameter_cell(calibration, name, document["parameters"])
        sigma = entry["sigma"]
        value = entry["value"]
        cells = (
            Cell("" if value is None else repr(float(value)), value=value),
            Cell("" if sigma is None or not entry["free"] else f"{sigma:.3g}", value=sigma),
            Cell("" if entry["unit"] == "1" else entry["unit"]),
            Cell(shown.kind, kind=shown.kind),
        )
        rows.append((name, cells))
    return Table(("parameter", "value", "sigma", "unit", ""), tuple(rows))


def circle_table(calibration: KinematicCalibration, document: Mapping[str, Any]) -> Table | None:
    """Return the fitted circles, or None where no joint was swept."""
    if calibration.circles is None:
        return None
    sigma = dict(
        zip(calibration.model.joints, calibration.circles.axis_sigma.tolist(), strict=True)
    )
    rows = []
    for circle in document["circles"]:
        known = sigma[circle["joint"]]
        numbers = ("points", "radius_mm", "arc_deg", "rms_mm", "sagitta_mm")
        formats = ("d", ".1f", ".0f", ".3f", ".2f")
        cells = [
            Cell(format(circle[key], style), value=circle[key])
            for key, style in zip(numbers, formats, strict=True)
        ]
        cells.append(Cell(f"{np.degrees(known):.3f}" if np.isfinite(known) else "not known"))
        rows.append((circle["joint"], tuple(cells)))
    headings = ("circle of", "points", "radius [mm]", "arc [deg]", "rms [mm]", "height [mm]")
    return Table((*headings, "axis known to [deg]"), tuple(rows))


def outlier_table(calibration: KinematicCalibration) -> Table:
    """Return the rows that were not believed, the worst first."""
    rows = np.flatnonzero(calibration.outliers)
    train = calibration.train
    rows = rows[np.argsort(-train.distances[rows], kind="stable")]
    found = []
    for row in rows.tolist():
        marker = train.observations.markers[train.observations.marker[row]]
        error = 1e3 * float(train.distances[row])
        cells = (Cell(marker), Cell(f"{error:.2f}", value=error))
        found.append((str(int(train.observations.sample[row])), cells))
    return Table(("sample", "point", "error [mm]"), tuple(found))


def start_table(calibration: KinematicCalibration) -> Table | None:
    """Return how every start fared, in the order in which they were tried."""
    search = calibration.search
    if search is None:
        return None
    best = float(np.min(search.scores)) or 1.0
    rows = [
        (f"{k + 1}", (Cell(label), Cell(f"{score / best:.4g}", value=score)))
        for k, (label, score) in enumerate(zip(search.labels, search.scores.tolist(), strict=True))
    ]
    return Table(("start", "from", "cost over the best"), tuple(rows))


def provenance(calibration: KinematicCalibration, document: Mapping[str, Any]) -> dict[str, str]:
    """Return what the model was made of and with."""
    model = calibration.model
    facts = {**model.provenance, **model.fit, **{f"robot {k}": v for k, v in model.robot.items()}}
    facts = {key: fact for key, fact in facts.items() if not isinstance(fact, Mapping)}
    facts["arm length"] = f"{1e3 * arm_length(model.chain):.2f} mm"
    noise = document["noise_sigma_mm"]
    facts["noise of a coordinate"] = "not known" if noise is None else f"{noise:.3f} mm"
    facts["steps of the solver"] = document["iterations"]
    facts["seconds"] = f"{document['seconds']:.2f}"
    return {str(key).replace("_", " "): str(value) for key, value in facts.items()}


def _parameter_cell(
    calibration: KinematicCalibration, name: str, parameters: Mapping[str, Any]
) -> Cell:
    """Return a parameter in the unit that people read, with its standard deviation."""
    if name not in parameters:
        return Cell("", kind="fixed")
    entry = parameters[name]
    value = entry["value"]
    if value is None:
        return Cell("not known", kind="unknown")
    factor = _SHOWN[entry["unit"]][1]
    if name.endswith("noise_sigma"):
        return Cell(decimals(factor * value, None), kind="derived", value=value)
    if not entry["free"]:
        return Cell(decimals(factor * value, None), "fixed", "fixed", value)
    sigma = None if entry["sigma"] is None else factor * entry["sigma"]
    note = "" if sigma is None else f"± {decimals(sigma, sigma)}"
    if name in blind_parameters(calibration):
        return Cell(decimals(factor * value, sigma), f"blind {note}".strip(), "blind", value)
    if sigma is None:
        return Cell(decimals(factor * value, None), "", "unknown", value)
    return Cell(decimals(factor * value, sigma), note, "free", value)
