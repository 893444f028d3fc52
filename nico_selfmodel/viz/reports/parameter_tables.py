"""The parameters of any calibration: as people read them, and to the last digit."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any

from nico_selfmodel.model.cameras.projection import EVERY_INTRINSIC, INTRINSICS
from nico_selfmodel.model.cameras.rig_parameters import POSE_NAMES
from nico_selfmodel.viz.figures.numbers_shown import decimals
from nico_selfmodel.viz.reports.tables import UNITS, Cell, Table

_COLUMNS = {
    "D": "D [mm]",
    "theta_offset": "θ offset [deg]",
    "r": "r [mm]",
    "alpha": "α [deg]",
    "beta": "β [deg]",
    "gear": "gear",
}
"""Of a joint's row: part of a parameter's name -> heading."""
_PLACES = ("x", "y", "z", "rx", "ry", "rz")


@dataclass(frozen=True)
class ParameterTables:
    """Parameters of a document, and those of them that must not be read as if they were known."""

    entries: Mapping[str, Mapping[str, Any]]
    """`parameters` of `result.json`."""
    unobservable: frozenset[str] = field(default=frozenset())
    """Parameters that take part in a direction which the data do not determine."""

    def cell(self, name: str) -> Cell:
        """Return a parameter in the unit that people read, with its standard deviation.

        Args:
            name: Of the parameter; one that is not in the document gives an empty cell.
        """
        entry = self.entries.get(name)
        if entry is None:
            return Cell("", kind="fixed")
        value, kind, factor = entry["value"], self.kind(name), UNITS[entry["unit"]][1]
        if value is None:
            return Cell("not known", kind=kind)
        if kind == "fixed":
            return Cell(f"{factor * value:g}".replace("-", "−"), kind, kind, value)
        sigma = None if entry["sigma"] is None else factor * entry["sigma"]
        note = "" if sigma is None else f"± {decimals(sigma, sigma)}"
        if kind == "unobservable":
            note = f"unobservable {note}".strip()
        return Cell(decimals(factor * value, sigma), note, kind, value)

    def kind(self, name: str) -> str:
        """Return what a parameter is: one of `Cell.kind`."""
        entry = self.entries[name]
        if entry["value"] is None:
            return "unknown"
        if not entry["free"]:
            return "fixed" if entry["sigma"] == 0.0 else "derived"
        if name in self.unobservable:
            return "unobservable"
        return "unknown" if entry["sigma"] is None else "free"

    def rows(self, headings: tuple[str, ...], names: Iterable[tuple[str, Iterable[str]]]) -> Table:
        """Return parameters that belong together in one row each.

        Args:
            headings: Of the label and of the parameters.
            names: Label and parameters of each row, which may be fewer than the headings.
        """
        found = []
        for label, parameters in names:
            cells = tuple(self.cell(name) for name in parameters)
            found.append((label, cells + (Cell(""),) * (len(headings) - 1 - len(cells))))
        return Table(headings, tuple(found))

    def everything(self) -> Table:
        """Return every parameter in SI units and pixels, to the last digit."""
        rows = tuple((name, self._exact(name)) for name in self.entries)
        return Table(("parameter", "value", "sigma", "unit", ""), rows)

    def _exact(self, name: str) -> tuple[Cell, ...]:
        entry, kind = self.entries[name], self.kind(name)
        value, sigma = entry["value"], entry["sigma"]
        return (
            Cell("" if value is None else repr(float(value)), value=value),
            Cell("" if sigma is None or kind == "fixed" else f"{sigma:.3g}", value=sigma),
            Cell("" if entry["unit"] == "1" else entry["unit"]),
            Cell(kind, kind=kind),
        )


def joint_table(parameters: ParameterTables, joints: tuple[str, ...]) -> Table:
    """Return the Denavit-Hartenberg rows and gears, one joint a row."""
    twisted = any(f"{joint}.beta" in parameters.entries for joint in joints)
    columns = {part: title for part, title in _COLUMNS.items() if part != "beta" or twisted}
    names = [(joint, [f"{joint}.{part}" for part in columns]) for joint in joints]
    return parameters.rows(("joint", *columns.values()), names)


def place_table(parameters: ParameterTables, markers: tuple[str, ...]) -> Table:
    """Return where the chain begins in the measuring frame, and the points on the hand."""
    found = [("M0: frame 0 in the measuring frame", "M0")]
    found += [(f"{marker}: point in the last frame", f"hand.{marker}") for marker in markers]
    rows = [
        (
            _with_unit(part),
            [f"{place}.{part}" for _, place in found[: None if part in "xyz" else 1]],
        )
        for part in _PLACES
    ]
    return parameters.rows(("", *(label for label, _ in found)), rows)


def lens_table(parameters: ParameterTables, cameras: tuple[str, ...]) -> Table:
    """Return the intrinsic parameters, one camera a column."""
    known = [n for n in EVERY_INTRINSIC if f"{cameras[0]}.{n}" in parameters.entries]
    rows = [
        (f"{name}{' [px]' * (name in INTRINSICS[:5])}", [f"{camera}.{name}" for camera in cameras])
        for name in known
    ]
    return parameters.rows(("lens", *cameras), rows)


def pose_table(parameters: ParameterTables) -> Table | None:
    """Return where cameras are in the first one's frame, one a column; None for one camera."""
    end = ".pose.x"
    placed = [name.removesuffix(end) for name in parameters.entries if name.endswith(end)]
    if not placed:
        return None
    rows = [(_with_unit(n), [f"{camera}.pose.{n}" for camera in placed]) for n in POSE_NAMES]
    if "baseline" in parameters.entries:
        rows.append(("baseline [mm]", ["baseline"]))
    return parameters.rows(("in the first camera's frame", *placed), rows)


def _with_unit(part: str) -> str:
    """Return a part of a pose with its unit: x to z, and rx to rz."""
    return f"{part} [{'deg' if part[0] == 'r' else 'mm'}]"
