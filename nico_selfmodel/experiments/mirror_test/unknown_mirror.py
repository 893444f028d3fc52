"""Stage 2 of the mirror test: where mirrors stand that the robot has never looked into."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from nico_selfmodel.experiments.experiment_report import Table
from nico_selfmodel.experiments.mirror_test.stage_document import stage_document
from nico_selfmodel.model.cameras.mirror import Mirror
from nico_selfmodel.sessions.mirrors.acquaintance import rendered
from nico_selfmodel.sessions.mirrors.knowing import Knowing, Refusal

HAND, WHOLE = "its hand", "its hand, head and chest"
"""What a robot has seen of itself in a mirror when it says where that stands."""

BOUNDS = {HAND: (0.3, 2.0), WHOLE: (0.1, 0.5)}
"""By what a robot has seen of itself in a mirror: how far that may be off [deg, mm]."""
ENOUGH = 10
"""Mirrors that a verdict takes."""


@dataclass(frozen=True)
class MirrorPlace:
    """How far one mirror is from where a robot says it stands."""

    by: str
    """`HAND` or `WHOLE`."""
    angle: float
    """Between the normals [rad]."""
    distance: float
    """Of its distance from the left camera, positive where it is said to be farther [m]."""
    chi_square: float
    """Of its three numbers, by the covariance that is said."""


@dataclass(frozen=True)
class MirrorsStage:
    """All mirrors of all robots."""

    places: tuple[MirrorPlace, ...]
    """Those told by the hand, then those told by all of the body, robot by robot."""
    refusals: tuple[Refusal, ...] = ()
    """What robots say who do not trust their mirrors."""


def place_mirrors(robots: Sequence[Knowing], refusals: Sequence[Refusal] = ()) -> MirrorsStage:
    """Hold mirrors as robots have learned them against where they stand.

    Args:
        robots: Who know their mirrors.
        refusals: Of those who do not trust them.
    """
    found = []
    for known in robots:
        truth = rendered(known.robot).ground_truth
        for by, mirrors in ((HAND, known.robot.model.mirrors), (WHOLE, known.body.places)):
            for name, view in known.before.views.items():
                true, own = truth.mirror(view.X_BM), mirrors[name]
                found.append(_place(by, own, true))
    return MirrorsStage(tuple(found), tuple(refusals))


def _place(by: str, own: Mirror, true: Mirror) -> MirrorPlace:
    """Compare one mirror with the true one, both before the left camera."""
    assert own.covariance is not None, "a learned mirror has a covariance"
    angle = float(np.linalg.norm(np.cross(own.normal, true.normal)))
    off = own.values - true.values
    chi_square = float(off @ np.linalg.solve(own.covariance, off))
    return MirrorPlace(by, angle, own.distance - true.distance, chi_square)


def mirrors_document(stage: MirrorsStage) -> dict[str, Any]:
    """Return the stage as plain data, with its status."""
    rows = [_row(stage, by) for by in BOUNDS if any(one.by == by for one in stage.places)]
    failed = [f"robot {one.robot} does not trust a mirror: {one.reason}" for one in stage.refusals]
    failed += [
        f"by {row['by']} {row['beyond']} of {row['mirrors']} mirrors are more than "
        f"{row['bound_deg']:g} deg or {row['bound_mm']:g} mm off"
        for row in rows
        if row["beyond"]
    ]
    count = rows[-1]["mirrors"] if rows else 0
    said = "no mirror was learned"
    if rows:
        said = (
            f"{count} mirrors are at most {rows[-1]['largest_deg']:.2f} deg and "
            f"{rows[-1]['largest_mm']:.2f} mm off"
        )
    lacking = f"{said}, {ENOUGH} mirrors are needed" if count < ENOUGH else None
    return stage_document("2", "an unknown mirror", failed, lacking, said, mirrors=rows)


def any_beyond(stage: MirrorsStage) -> bool:
    """Return whether a mirror that a robot trusts is not where it says."""
    return any(row["beyond"] for row in mirrors_document(stage)["mirrors"])


def _row(stage: MirrorsStage, by: str) -> dict[str, Any]:
    """Return what is told of mirrors by one part of the body."""
    own = [one for one in stage.places if one.by == by]
    degrees = np.degrees([one.angle for one in own])
    mm = 1e3 * np.abs([one.distance for one in own])
    most = BOUNDS[by]
    return {
        "by": by,
        "mirrors": len(own),
        "median_deg": float(np.median(degrees)),
        "largest_deg": float(np.max(degrees)),
        "bound_deg": most[0],
        "median_mm": float(np.median(mm)),
        "largest_mm": float(np.max(mm)),
        "bound_mm": most[1],
        "beyond": int(np.sum((degrees > most[0]) | (mm > most[1]))),
        "chi_square": float(np.mean([one.chi_square for one in own])),
    }


def mirrors_table(stage: MirrorsStage) -> Table:
    """Return a row for each part of the body."""
    headings = (
        "told by", "mirrors", "median, largest [deg]", "bound [deg]", "median, largest [mm]",
        "bound [mm]", "mean chi² / 3",
    )  # fmt: skip
    rows = [
        [
            row["by"],
            str(row["mirrors"]),
            f"{row['median_deg']:.3f}, {row['largest_deg']:.3f}",
            f"{row['bound_deg']:g}",
            f"{row['median_mm']:.2f}, {row['largest_mm']:.2f}",
            f"{row['bound_mm']:g}",
            f"{row['chi_square'] / 3.0:.2f}",
        ]
        for row in mirrors_document(stage)["mirrors"]
    ]
    return Table("Stage 2: where a mirror stands", headings, rows, "\n")
