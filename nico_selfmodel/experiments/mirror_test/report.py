"""The mirror test as tables, a chart and JSON: each stage that exists against its bounds."""

from typing import Any

import numpy as np

from nico_selfmodel.estimation.contingency.contingency import ODDS, SELF
from nico_selfmodel.experiments.experiment_report import ExperimentReport, Table
from nico_selfmodel.experiments.mirror_test.encounters import (
    ENCOUNTERS,
    EXPECTED,
    LONGEST,
    EncounterStage,
    Trial,
)
from nico_selfmodel.sessions.motion_session import PERIOD
from nico_selfmodel.viz.figures.mirror_test.contingency_plot import contingency_plot

SELF_WITHIN = 5.0
"""Bound of the time in which self is told [s]; that of the others is `LONGEST`."""
ENOUGH = 100
"""Trials in which none may be wrong."""


def report_of(stage: EncounterStage) -> ExperimentReport:
    """Return the verdict of the first stage, and what it rests on."""
    rows = [_row(name, [t for t in stage.trials if t.encounter == name]) for name in EXPECTED]
    status, reasons = _verdict(stage, rows)
    document = {
        "status": status,
        "reasons": reasons,
        "stages": [{"stage": "1", "name": "contingency", "status": status, "encounters": rows}],
        "robots": [_robot(stage, robot) for robot in stage.responses],
    }
    head = (
        "# The mirror test\n\n"
        f"**{status}**: {'; '.join(reasons)}.\n\n"
        "Stage 1, contingency: whose motion follows one's own? No later stage is part of this "
        f"test. {len(stage.responses)} simulated robot(s) that learned cameras and arm by "
        f"themselves, {len(stage.trials)} encounters in random order, one camera, a picture every "
        f"{1e3 * PERIOD:.0f} ms; odds of {ODDS:,.0f} to 1 stop the test.\n\n"
    )
    return ExperimentReport(head, (_table(rows), _given()), _charts(stage, reasons), document)


def _row(name: str, trials: list[Trial]) -> dict[str, Any]:
    """Return what happened in one kind of encounter."""
    told = [t.found.seconds for t in trials if t.found.log_odds.size and _told(t)]
    verdicts = [t.found.verdict for t in trials]
    return {
        "encounter": name,
        "expected": EXPECTED[name],
        "trials": len(trials),
        "verdicts": {verdict: verdicts.count(verdict) for verdict in sorted(set(verdicts))},
        "wrong": sum(t.wrong for t in trials),
        "undecided": sum(not _told(t) for t in trials),
        "median_s": float(np.median(told)) if told else None,
        "longest_s": max(told) if told else None,
        "bound_s": SELF_WITHIN if EXPECTED[name] == SELF else LONGEST,
    }


def _told(trial: Trial) -> bool:
    """Return whether self was told or ruled out."""
    return bool((np.abs(trial.found.log_odds) >= np.log(ODDS)).any())


def _verdict(stage: EncounterStage, rows: list[dict[str, Any]]) -> tuple[str, list[str]]:
    """Return the status and why it is that."""
    reasons = []
    for row in rows:
        what = f"{row['encounter']}: "
        if row["wrong"]:
            reasons.append(f"{what}{row['wrong']} of {row['trials']} verdicts are wrong")
        if row["undecided"]:
            reasons.append(f"{what}{row['undecided']} of {row['trials']} could not be told")
        if row["longest_s"] is not None and row["longest_s"] > row["bound_s"]:
            reasons.append(
                f"{what}{row['longest_s']:.1f} s, at most {row['bound_s']:g} s are allowed"
            )
    if reasons:
        return "FAIL", reasons
    count = len(stage.trials)
    if count < ENOUGH:
        return "NOT_EVALUATED", [f"none of {count} verdicts is wrong, {ENOUGH} trials are needed"]
    return "PASS", [f"none of {count} verdicts is wrong, and all fell in time"]


def _robot(stage: EncounterStage, robot: int) -> dict[str, Any]:
    """Return what one robot learned of its own motion, beside the truth."""
    response = stage.responses[robot]
    return {
        "seed": robot,
        "delay_s": [response.delay * PERIOD, (response.delay + 1) * PERIOD],
        "latency_true_s": stage.latencies[robot],
        "seen_after_still_or_moved": response.seen.tolist(),
        "seen_where_nobody_is": response.unprompted,
    }


def _table(rows: list[dict[str, Any]]) -> Table:
    headings = ("encounter", "is", "trials", "said", "wrong", "median s", "longest s", "bound s")
    cells = [
        [
            row["encounter"],
            row["expected"],
            str(row["trials"]),
            ", ".join(f"{verdict} {count}" for verdict, count in row["verdicts"].items()),
            str(row["wrong"]),
            "-" if row["median_s"] is None else f"{row['median_s']:.1f}",
            "-" if row["longest_s"] is None else f"{row['longest_s']:.1f}",
            f"{row['bound_s']:g}",
        ]
        for row in rows
    ]
    return Table("Stage 1: is it me, by the timing of motion", headings, cells)


def _given() -> Table:
    """Return what the robot was given, and what it learned."""
    rows = [
        ["arm and cameras", "learned, from pictures of a chessboard and of its own hand"],
        ["delay of its pictures", "learned, from its arm seen directly"],
        ["how surely motion is seen", "learned, likewise"],
        ["names of its links and which follows which", "given, by its description"],
        ["where its head is turned, poses that a mirror shows", "given, by its description"],
        ["odds that stop the test", "derived: 100 to 1 that of 100 verdicts not one is wrong"],
        ["threshold of the motion mask", "derived: one false cell in 1000 still pictures"],
    ]
    return Table(
        "What the robot was given, and what it learned", ("what", "from where"), rows, "\n"
    )


def _charts(stage: EncounterStage, reasons: list[str]) -> dict[str, Any]:
    """Draw the log odds of every trial."""
    traces = {
        one.name: [t.found.log_odds for t in stage.trials if t.encounter == one.name]
        for one in ENCOUNTERS
    }
    own = next(one.name for one in ENCOUNTERS if one.mirror)
    title = "Its mirror image is itself, whoever else moves is not: " + reasons[0]
    return {"contingency": contingency_plot(traces, own, PERIOD, float(np.log(ODDS)), title)}
