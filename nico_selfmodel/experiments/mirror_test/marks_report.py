"""Stages 5 to 8 of the mirror test in the report: marks found, places, controls, removal."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from nico_selfmodel.estimation.mirrors.mark_place import NOT_ON_ME, ON_GLASS, ON_ME
from nico_selfmodel.experiments.experiment_report import Table
from nico_selfmodel.experiments.mirror_test.marks import MarkStage, MarkTrial
from nico_selfmodel.experiments.mirror_test.painting import (
    MARK,
    ON_THE_GLASS,
    OTHER_ROBOT,
    SEEN_DIRECTLY,
    SHAM_ACT,
    SHAM_PAINT,
)
from nico_selfmodel.experiments.mirror_test.stage_document import stage_document
from nico_selfmodel.geometry.rotation import tangent_basis
from nico_selfmodel.sessions.mirrors.knowing import LINKS, MARKED
from nico_selfmodel.viz.figures.mirror_test.surprise_plot import surprise_plot

LEAST_HITS = 0.95
"""Share of the marks that must be found, and more."""
MEDIAN_MM, P95_MM = 3.0, 8.0
"""Bounds of how far places are off."""
HONEST = (0.8, 1.3)
"""Bounds of the mean chi-square of a place, over its two degrees of freedom: it is on a surface."""
ENOUGH_MARKS, ENOUGH_SHAMS, ENOUGH_OTHERS, ENOUGH_REMOVALS = 50, 25, 12, 25
"""Trials that verdicts take: marks; shams; marks on the glass, on another robot, and seen directly,
of each; removals."""
WANTED = {
    SHAM_PAINT: "nothing",
    SHAM_ACT: "nothing",
    ON_THE_GLASS: ON_GLASS,
    OTHER_ROBOT: NOT_ON_ME,
    SEEN_DIRECTLY: "on me, once",
}
"""What is true of each control."""
NO_MISTAKE = {kind: (told,) for kind, told in WANTED.items()} | {
    OTHER_ROBOT: (NOT_ON_ME, "nothing"),
    SEEN_DIRECTLY: (ON_ME, "nothing"),
}
"""What may be said of it: who does not notice a mark on another robot did not take it for its own,
and who misses one on itself, which counts among the marks that must be found, not for two."""

_ARM = MARKED[len(LINKS) :]


def marks_documents(stage: MarkStage) -> list[dict[str, Any]]:
    """Return the stages as plain data, with their statuses; one that fails is the last."""
    found = []
    for judge in (_hits, _controls, _places, _removals):
        found.append(judge(stage))
        if found[-1]["status"] == "FAIL":
            break
    return found


def said_of(trial: MarkTrial) -> str:
    """Return what a robot says of what it found: the kinds, or `nothing`.

    What is seen directly and in the mirror is two marks to who does not know that it is one; there
    each that is found is told, and which other link it is put on.
    """
    if trial.painted.kind != SEEN_DIRECTLY:
        return ", ".join(dict.fromkeys(one.kind for one in trial.found)) or "nothing"
    mark = trial.painted.mark
    own = None if mark is None else mark.link
    each = (one.kind if one.link in (own, None) else f"on {one.link}" for one in trial.found)
    return ", ".join(each) or "nothing"


def _of(stage: MarkStage, *kinds: str) -> list[MarkTrial]:
    return [trial for trial in stage.trials if trial.painted.kind in kinds]


def _hit(trial: MarkTrial) -> bool:
    """Return whether one mark, and one only, is said to be on me."""
    return [one.kind for one in trial.found] == [ON_ME]


def _document(
    stage: str, name: str, failed: list[str], said: str, needed: str | None, **facts: Any
) -> dict[str, Any]:
    """Return a stage as plain data; `needed` is what too few trials lack."""
    lacking = None if needed is None else f"{said}; {needed} are needed"
    return stage_document(stage, name, failed, lacking, said, **facts)


def _hits(stage: MarkStage) -> dict[str, Any]:
    trials, too = _of(stage, MARK), _of(stage, SEEN_DIRECTLY)
    hits, own = sum(map(_hit, trials)), sum(map(_hit, too))
    said = f"{hits} of {len(trials)} marks are found"
    if too:
        said += f", and {own} of {len(too)} that are seen directly, too"
    # More than the share of those in the mirror only, and of both together.
    each = ((hits, len(trials)), (hits + own, len(trials) + len(too)))
    missed = any(of and found <= LEAST_HITS * of for found, of in each)
    failed = [f"{said}, more than {100 * LEAST_HITS:.0f} of 100 must be"] if missed else []
    return _document(
        "5",
        "marks of 10 mm, step of colour 0.2, seen in the mirror",
        failed,
        said,
        f"{ENOUGH_MARKS} marks" if len(trials) < ENOUGH_MARKS else None,
        not_judged=[
            "the hand that moves and its wrist",
            "what is seen directly and does not change",
        ],
        marks=len(trials),
        hits=hits,
        seen_directly_too=len(too),
        hits_of_these=own,
        several=sum(len(trial.found) > 1 for trial in trials),
        trials=[_row(trial) for trial in trials],
    )


def _row(trial: MarkTrial) -> dict[str, Any]:
    """Return one mark as plain data: where it was, and what was said."""
    mark = trial.painted.mark
    assert mark is not None
    off = errors_of([trial])[0]
    return {
        "robot": trial.robot,
        "link": mark.link,
        "true_mm": (1e3 * mark.p_FM).round(1).tolist(),
        "color": mark.color.round(3).tolist(),
        "said": said_of(trial),
        "off_mm": round(float(off[0]), 2) if len(off) else None,
    }


def _controls(stage: MarkStage) -> dict[str, Any]:
    rows = [_control(stage, kind) for kind in WANTED]
    failed = [
        f"{row['control']}: {row['trials'] - row['right']} of {row['trials']} are answered wrongly"
        for row in rows
        if row["right"] < row["trials"]
    ]
    sham, same, *others = (row["trials"] for row in rows)
    few = sham + same < ENOUGH_SHAMS or min(others) < ENOUGH_OTHERS
    needed = (
        f"{ENOUGH_SHAMS} shams, and {ENOUGH_OTHERS} marks each on the glass, on another robot and "
        "seen directly"
    )
    return _document(
        "5b-d",
        "controls",
        failed,
        f"all of {sham + same + sum(others)} controls are answered rightly",
        needed if few else None,
        controls=rows,
    )


def _control(stage: MarkStage, kind: str) -> dict[str, Any]:
    said = [said_of(trial) for trial in _of(stage, kind)]
    return {
        "control": kind,
        "expected": WANTED[kind],
        "trials": len(said),
        "said": {one: said.count(one) for one in sorted(set(said))},
        "right": sum(one in NO_MISTAKE[kind] for one in said),
    }


def errors_of(trials: Sequence[MarkTrial]) -> tuple[np.ndarray, np.ndarray, int]:
    """Return how far places on the right link are off, and the links that were wrong.

    A chi-square is that of the error along the surface, which has two degrees of freedom: the
    surface is the description's, as the simulated robot's is.

    Args:
        trials: With marks on the body.

    Returns:
        Distances [mm] and chi-squares over two of marks that were found. Shapes (k,). And how
        many were put on another link.
    """
    off, chi, wrong = [], [], 0
    for trial in trials:
        mark = trial.painted.mark
        normal = trial.painted.normal
        if mark is None or normal is None or not _hit(trial):
            continue
        one = trial.found[0]
        if one.link != mark.link or one.p_FM is None or one.covariance is None:
            wrong += 1
            continue
        error = one.p_FM - mark.p_FM
        off.append(1e3 * float(np.linalg.norm(error)))
        along = tangent_basis(normal).T
        flat = along @ error
        chi.append(float(flat @ np.linalg.solve(along @ one.covariance @ along.T, flat)) / 2.0)
    return np.array(off), np.array(chi), wrong


def _places(stage: MarkStage) -> dict[str, Any]:
    off, chi, wrong = errors_of(_of(stage, MARK))
    failed = [f"{wrong} of {wrong + len(off)} marks are put on another link"] if wrong else []
    about = "6", "place and link"
    if not len(off):
        none = "no mark was put to its link"
        return stage_document(*about, failed, none, none, places=0, wrong_links=wrong)
    median, p95, mean = float(np.median(off)), float(np.percentile(off, 95)), float(np.mean(chi))
    if median > MEDIAN_MM or p95 > P95_MM:
        failed.append(
            f"places are off by {median:.1f} mm in the middle and {p95:.1f} mm at 95 of 100, at "
            f"most {MEDIAN_MM:g} and {P95_MM:g} are allowed"
        )
    enough = int(0.9 * ENOUGH_MARKS)
    if len(off) >= enough and not HONEST[0] <= mean <= HONEST[1]:
        failed.append(f"chi-square over 2 is {mean:.2f}, {HONEST[0]:g} to {HONEST[1]:g} is honest")
    said = f"{len(off)} places are off by {median:.1f} mm in the middle, {p95:.1f} at 95 of 100"
    return _document(
        *about,
        failed,
        said,
        f"{enough} places" if len(off) < enough else None,
        places=len(off),
        wrong_links=wrong,
        median_mm=median,
        p95_mm=p95,
        max_mm=float(off.max()),
        chi_square_over_2=mean,
        chi_square_over_2_median=float(np.median(chi)),
    )


def _removals(stage: MarkStage) -> dict[str, Any]:
    after = [trial.after for trial in stage.trials if trial.after is not None]
    still = sum(any(one.kind == ON_ME for one in found) for found in after)
    failed = [f"{still} of {len(after)} marks are still seen after they are gone"] if still else []
    failed += [
        f"robot {one.robot}: its monitor says that something changed: {one.changed}"
        for one in stage.watched
        if one.changed is not None
    ]
    said = f"none of {len(after)} marks is seen after it was removed"
    if stage.watched:
        said += f", and the monitor says of {len(stage.watched)} bodies that nothing changed"
    lacking = [] if stage.watched else ["what `monitor` says"]
    return _document(
        "8",
        "after removal",
        failed,
        said,
        f"{ENOUGH_REMOVALS} removals" if len(after) < ENOUGH_REMOVALS else None,
        not_evaluated=lacking,
        removals=len(after),
        still_seen=still,
        watched=[vars(one) for one in stage.watched],
    )


def marks_tables(stage: MarkStage) -> tuple[Table, ...]:
    """Return what was said of everything, and how far places are off."""
    rows = []
    for kind in (MARK, *WANTED):
        said = [said_of(trial) for trial in _of(stage, kind)]
        words = ", ".join(f"{one} {said.count(one)}" for one in sorted(set(said)))
        rows.append([kind, WANTED.get(kind, ON_ME), str(len(said)), words or "-"])
    after = [trial.after for trial in stage.trials if trial.after is not None]
    gone = sum(not any(one.kind == ON_ME for one in found) for found in after)
    rows.append(["mark taken off", "nothing", str(len(after)), f"no mark on me {gone}"])
    same = sum(one.changed is None for one in stage.watched)
    rows.append(
        ["body watched after it", "unchanged", str(len(stage.watched)), f"unchanged {same}"]
    )
    places = []
    for link, links in (("head", ("head",)), ("chest", ("chest",)), ("arm", _ARM)):
        own = [t for t in _of(stage, MARK) if t.painted.mark and t.painted.mark.link in links]
        off, chi, wrong = errors_of(own)
        numbers = (
            [f"{np.median(off):.1f}", f"{np.percentile(off, 95):.1f}", f"{np.mean(chi):.2f}"]
            if len(off)
            else ["-"] * 3
        )
        places.append([link, str(len(own)), str(sum(map(_hit, own))), str(wrong), *numbers])
    return (
        Table("Stages 5 and 8: marks and controls", ("done", "is", "trials", "said"), rows, "\n"),
        Table(
            "Stage 6: where the marks are",
            ("on", "marks", "found", "wrong link", "median mm", "p95 mm", "chi-square / 2"),
            places,
            "\n",
        ),
    )


def marks_chart(stage: MarkStage) -> Any:
    """Draw one look at a mark: seen, expected, surprise; None where there was no mark."""
    if stage.shown is None:
        return None
    painted, pair = stage.shown
    looks = {one.side: (one.picture, one.expected.picture, one.surprise.chi_square) for one in pair}
    places = {one.side: [(blob.u, blob.v) for blob in one.blobs] for one in pair}
    link = "body" if painted.mark is None else painted.mark.link
    return surprise_plot(looks, places, f"A mark of 10 mm on the {link}, in the mirror")
