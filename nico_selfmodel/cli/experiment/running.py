"""What every experiment's command does: refuse, run, write, print."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from nico_selfmodel.cli import printer

if TYPE_CHECKING:
    from nico_selfmodel.systems import World

Table = tuple[str, Sequence[str], Sequence[Sequence[str]]]
"""Title, headings and rows."""


def told(document: dict[str, Any], tables: Sequence[Table], out: Path, as_json: bool) -> None:
    """Print an experiment's tables and where they lie, or its document."""
    if as_json:
        printer.as_json(document)
        return
    for title, headings, rows in tables:
        printer.table(title, headings, rows)
    printer.folder(out)


def imperfect(name: str, joint_noise_deg: float | None) -> "World":
    """Return the imperfections that options name.

    Raises:
        ValueError: If there are none of that name.
    """
    from nico_selfmodel.systems import world_named

    return world_named(name).with_noise(play_deg=joint_noise_deg)


def plausible_pixel_sigma(sigma: float) -> float:
    """Return the noise of a pixel coordinate, refused where it cannot be meant.

    Raises:
        ValueError: If it is 10 px or more.
    """
    if sigma >= 10.0:
        raise ValueError(f"--pixel-sigma must lie between 0 and 10 px, got {sigma}")
    return sigma
