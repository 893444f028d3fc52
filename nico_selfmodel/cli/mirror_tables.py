"""Tables of mirrors on the terminal."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from nico_selfmodel.cli import console

_STATISTICS = ("mean", "SD", "rms", "median", "max")


def print_mirrors(name: str, document: Mapping[str, Any], folder: Path) -> None:
    """Print a result document of mirrors: errors, planes, verdict, and where it lies."""
    rows = []
    for label, key in (
        ("held out", "test"),
        ("cross-validation", "cross_validation"),
        ("training", "train"),
    ):
        block = document[key]
        rows.append(_row(f"{label}, px", block, "pixels"))
        if block is not None and "position_mm" in block:
            rows.append(_row(f"{label}, mm", block, "position_mm"))
    console.print_table(name, ("error", "n", *_STATISTICS), rows)
    headings = ("mirror", "poses", "from left eye, mm", "normal, deg", "flat")
    console.print_table("mirrors", headings, _mirror_rows(document))
    console.print_outliers(document)
    console.print_verdict(document["status"], document["reasons"], document.get("warnings", ()))
    console.print_where(folder)


def _mirror_rows(document: Mapping[str, Any]) -> list[list[str]]:
    rows = []
    for name, entry in document["mirrors"].items():
        sigma = document["parameters"][f"mirror.{name}.distance"]["sigma"]
        known = "" if sigma is None else f" +- {1e3 * sigma:.1f}"
        test = entry["flatness"]
        flat = "not tested" if test is None else "yes" if test["flat"] else "no"
        distance = f"{entry['distance_mm']:.1f}{known}"
        poses = str(entry["poses"])
        rows.append([name, poses, distance, f"{entry['normal_sigma_deg']:.2f}", flat])
    return rows


def _row(label: str, block: Mapping[str, Any] | None, quantity: str) -> list[str]:
    if block is None:
        return [label, *["-"] * (1 + len(_STATISTICS))]
    values = block[quantity]
    return [label, str(block["n"]), *(console.three_digits(values[s.lower()]) for s in _STATISTICS)]
