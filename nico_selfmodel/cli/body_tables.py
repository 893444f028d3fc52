"""Tables of whole bodies, tools and health on the terminal."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from nico_selfmodel.cli import console

_STATISTICS = ("mean", "SD", "rms", "median", "max")
_SHOWN = ("left.fx", "right.fx", "baseline", "link.upper", "link.lower")


def print_body(name: str, document: Mapping[str, Any], folder: Path) -> None:
    """Print a result document of a body: errors, boards, noise, verdict, and where it lies."""
    rows = []
    sets = (("held out", "test"), ("in turn", "cross_validation"), ("training", "train"))
    for label, key in sets:
        block = document[key]
        rows.append(_row(f"{label}, mm from its own eyes", block, "position_mm"))
        rows.append(_row(f"{label}, px", block, "pixels"))
    console.print_table(name, ("error", "poses", *_STATISTICS), rows)
    _print_boards(document)
    console.print_table(
        "what disturbs the hand's pixels, and lengths", ("", "value"), _facts(document)
    )
    console.print_outliers(document)
    console.print_verdict(document["status"], document["reasons"], document.get("warnings", ()))
    console.print_where(folder)


def print_sight(title: str, label: str, block: Mapping[str, Any]) -> None:
    """Print the errors of a body on new sightings, in space where both eyes saw, and in images."""
    rows = [_row(f"{label}, mm from its own eyes", block, "position_mm")]
    rows.append(_row(f"{label}, px", block, "pixels"))
    console.print_table(title, ("error", "poses", *_STATISTICS), rows)


def print_tool(name: str, document: Mapping[str, Any], folder: Path) -> None:
    """Print a result document of a tool."""
    rows = []
    for label, key in (("held out", "test"), ("training", "train")):
        block = document[key]
        quantity = "position_mm" if block and "position_mm" in block else "pixels"
        unit = "mm" if quantity == "position_mm" else "px"
        rows.append(_row(f"{label}, {unit}", block, quantity))
    console.print_table(f"{name}: {document['tool']}", ("error", "n", *_STATISTICS), rows)
    reach = document["reach_mm"]
    place = "where it was" if document["known"] else "the hand's point"
    console.out.print(f"tip {reach['value']:.1f} +- {reach['sigma']:.1f} mm from {place}")
    console.print_verdict(document["status"], document["reasons"], document.get("warnings", ()))
    console.print_where(folder)


def print_rezero(name: str, document: Mapping[str, Any], folder: Path) -> None:
    """Print a result document of new zeros."""
    rows = []
    for joint, shift in document["shift_deg"].items():
        entry = document["parameters"].get(f"{joint}.theta_offset")
        sigma = "held" if entry is None else f"{57.29578 * entry['sigma']:.2f}"
        rows.append([joint, f"{shift:+z.2f}", sigma])
    console.print_table(name, ("zero of", "moved by [deg]", "sigma [deg]"), rows)
    console.print_verdict(document["status"], document["reasons"], document.get("warnings", ()))
    console.print_where(folder)


def print_health(name: str, document: Mapping[str, Any]) -> None:
    """Print a health report."""
    found = document["log_ratio"]
    rows = [
        ["innovation squared, a coordinate", f"{document['nis_per_coordinate']:.2f}", "1"],
        ["ln R (Shiryaev, Roberts)", f"{found['largest']:.1f}", f"{found['threshold']:.0f}"],
    ]
    console.print_table(f"{name}: {document['poses']} poses", ("", "found", "limit"), rows)
    causes = [
        [c["cause"], f"{c['statistic']:.1f}", str(c["dof"]), f"{c['score']:.1f}"]
        for c in document["causes"]
    ]
    if causes:
        console.print_table("what may have changed", ("cause", "ratio", "dof", "score"), causes)
    console.print_verdict(document["status"], document["reasons"], document.get("warnings", ()))
    if document["causes"]:
        console.out.print(f"learn just that: {document['causes'][0]['command']}", markup=False)


def _print_boards(document: Mapping[str, Any]) -> None:
    boards = document["boards"]
    if boards is None:
        return
    rows = []
    for label in ("before", "after"):
        found = boards[label]
        if found is not None:
            rows.append(
                [
                    label,
                    str(found["boards"]),
                    f"{found['edge_mm']['sd']:.2f}",
                    f"{100.0 * (found['scale']['mean'] - 1.0):+z.2f}",
                    f"{found['position_mm']['mean']:.2f}",
                ]
            )
    title = "held-out boards" if boards["held_out"] else "boards learned from"
    headings = ("eyes", "boards", "edge SD [mm]", "scale [%]", "corner [mm]")
    console.print_table(title, headings, rows)


def _facts(document: Mapping[str, Any]) -> list[list[str]]:
    from nico_selfmodel.estimation.body.body_result import noise_words

    tracker, play = noise_words(document)
    rows = [
        ["tracker", tracker],
        ["joint play, standard deviation", play],
        ["scale held by", document["scale_from"]],
    ]
    work = document["workspace"]
    rows.append(["hand known to, by more data", f"{work['learned_mm']['mean']:.2f} mm"])
    rows.append(["hand known to, by the mechanics", f"{work['mechanics_mm']['mean']:.2f} mm"])
    for name in _SHOWN:
        entry = document["parameters"].get(name)
        if entry is not None:
            length = entry["unit"] == "m"
            value = f"{1e3 * entry['value']:.2f} mm" if length else f"{entry['value']:.2f} px"
            rows.append([name, value])
    return rows


def _row(label: str, block: Mapping[str, Any] | None, quantity: str) -> list[str]:
    if block is None or quantity not in block:
        return [label, *["-"] * (1 + len(_STATISTICS))]
    values = block[quantity]
    count = block.get("poses", block["n"])
    return [label, str(count), *(f"{values[name.lower()]:.2f}" for name in _STATISTICS)]
