"""The first stage of the mirror test in the report: whose motion follows one's own."""

from typing import Any

import numpy as np

from nico_selfmodel.estimation.contingency.contingency import ODDS, SELF
from nico_selfmodel.experiments.experiment_report import Table
from nico_selfmodel.experiments.mirror_test.encounters import (
    ENCOUNTERS,
    EXPECTED,
    LONGEST,
    EncounterStage,
    Trial,
)
from nico_selfmodel.experiments.mirror_test.stage_document import stage_document
from nico_selfmodel.sessions.motion_session import PERIOD
from nico_selfmodel.viz.figures.mirror_test.contingency_plot import contingency_plot

SELF_WITHIN = 5.0
"""Bound of the time in which self is told [s]; that of the others is `LONGEST`."""
LIKELY = 100.0
"""Odds, to one, of which it is told beside when they were reached; verdicts take `ODDS`."""
ENOUGH = 100
"""Trials in which none may be wrong."""


def encounters_document(stage: EncounterStage) -> dict[str, Any]:
    """Return the stage as plain data, with its status."""
    rows = [_row(name, [t for t in stage.trials if t.encounter == name]) for name in EXPECTED]
    count = len(stage.trials)
    right = f"none of {count} verdicts is wrong"
    return stage_document(
        "1",
        "contingency",
        _failed(rows),
        f"{right}, {ENOUGH} trials are needed" if count < ENOUGH else None,
        f"{right}, and all fell in time",
        encounters=rows,
        robots=[_robot(stage, robot) for robot in stage.responses],
    )


def _row(name: str, trials: list[Trial]) -> dict[str, Any]:
    """Return what happened in one kind of encounter."""
    known = [t for t in trials if t.found.log_odds.size and _told(t)]
    told, likely = [t.found.seconds for t in known], [_likely(t) for t in known]
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
        "longest_to_100_s": max(likely) if likely else None,
        "bound_s": SELF_WITHIN if EXPECTED[name] == SELF else LONGEST,
    }


def _likely(trial: Trial) -> float:
    """Return when odds of `LIKELY` to one were reached, and kept up to the verdict [s]."""
    odds = trial.found.log_odds[: round(trial.found.seconds / PERIOD)]
    before = np.flatnonzero(np.sign(odds[-1]) * odds < np.log(LIKELY))
    return PERIOD * (int(before[-1]) + 2 if len(before) else 1)


def _told(trial: Trial) -> bool:
    """Return whether self was told or ruled out."""
    return bool((np.abs(trial.found.log_odds) >= np.log(ODDS)).any())


def _failed(rows: list[dict[str, Any]]) -> list[str]:
    """Return what fails the stage."""
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
    return reasons


def _robot(stage: EncounterStage, robot: int) -> dict[str, Any]:
    """Return what one robot learned of its own motion, beside the truth."""
    response = stage.responses[robot]
    return {
        "seed": robot,
        "delay_s": [response.delay * PERIOD, (response.delay + 1) * PERIOD],
        "latency_true_s": stage.latencies[robot],
        "seen_after_still_little_or_much": response.seen.tolist(),
        "seen_where_nobody_is": response.unprompted,
    }


def encounters_table(stage: EncounterStage) -> Table:
    """Return a row for each kind of encounter."""
    headings = (
        *("encounter", "is", "trials", "said", "wrong", "median s", "longest s"),
        *("to 100:1 s", "bound s"),
    )
    cells = [
        [
            row["encounter"],
            row["expected"],
            str(row["trials"]),
            ", ".join(f"{verdict} {count}" for verdict, count in row["verdicts"].items()),
            str(row["wrong"]),
            "-" if row["median_s"] is None else f"{row['median_s']:.1f}",
            "-" if row["longest_s"] is None else f"{row['longest_s']:.1f}",
            "-" if row["longest_s"] is None else f"{row['longest_to_100_s']:.1f}",
            f"{row['bound_s']:g}",
        ]
        for row in encounters_document(stage)["encounters"]
    ]
    return Table("Stage 1: is it me, by the timing of motion", headings, cells)


def encounters_chart(stage: EncounterStage) -> Any:
    """Draw the log odds of every trial."""
    traces = {
        one.name: [t.found.log_odds for t in stage.trials if t.encounter == one.name]
        for one in ENCOUNTERS
    }
    own = next(one.name for one in ENCOUNTERS if one.mirror)
    title = (
        "Its mirror image is itself, whoever else moves is not: "
        + encounters_document(stage)["reasons"][0]
    )
    return contingency_plot(traces, own, PERIOD, float(np.log(ODDS)), title)
