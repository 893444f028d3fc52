"""A health report as plain data: what goes into `result.json`."""

from typing import Any

from nico_selfmodel.estimation.monitoring.diagnosis import alike_to
from nico_selfmodel.estimation.monitoring.health import HealthReport
from nico_selfmodel.estimation.noise.contradictions import WHERE_TO_LOOK

_CAUSES_SHOWN = 5


def health_document(report: HealthReport, left: str | None = None) -> dict[str, Any]:
    """Return a health report as plain data; `status` is FAIL where something changed.

    Args:
        left: What the likeliest cause leaves once it is learned anew; None where it explains all,
            or that was not asked.
    """
    against = report.contradictions
    return {
        "status": "PASS" if report.healthy else "FAIL",
        "reasons": _reasons(report, left),
        "poses": len(report.nis),
        "nis_per_coordinate": float(report.nis.sum() / report.dof.sum()),
        "log_ratio": {"largest": float(report.log_ratio.max()), "threshold": report.threshold},
        "false_alarm_chance": report.false_alarm_chance,
        "misfit": {"per_coordinate": report.misfit.per_coordinate, "most": report.misfit.most},
        "contradicting": {
            "samples": report.sample[against.found].tolist(),
            "most": against.most,
        },
        "changed_at": _sample(report, report.changed_at),
        "explained": left is None,
        "alarm_at": _sample(report, report.alarm_at),
        "causes": [
            {
                "cause": found.hypothesis.cause,
                "statistic": found.statistic,
                "dof": found.dof,
                "score": float(found.score),
                "parameters": list(found.hypothesis.names),
            }
            for found in report.diagnoses[:_CAUSES_SHOWN]
        ],
    }


def _reasons(report: HealthReport, left: str | None) -> list[str]:
    """Return what the verdict rests on, what counts most first."""
    chance, against = report.false_alarm_chance, report.contradictions
    reasons = [
        f"{len(report.nis)} poses fit what is known of the body; with noise as in the "
        f"{report.noise.poses} poses that it was learned from, at most {100.0 * chance:.2g} % of "
        "such recordings raise a false alarm"
    ]
    if report.misread is not None:
        reasons = [report.misread]
    elif report.alarm_at is not None and report.changed_at is not None:
        best = report.diagnoses[0]
        when = (
            f"something changed at sample {int(report.sample[report.changed_at])}, seen at sample "
            f"{int(report.sample[report.alarm_at])}"
        )
        alike = [one.hypothesis.cause for one in report.diagnoses[1:] if alike_to(best, one)]
        either = "; nothing tells them apart" if alike else ""
        likeliest = (
            f"{' or '.join([best.hypothesis.cause, *alike])} (likelihood ratio "
            f"{best.statistic:.0f}, chi-square of {best.dof}{either})"
        )
        reasons = [f"{when}: {likeliest}"]
        if left is not None:
            reasons = [
                f"{when}, and no one cause explains it: of {likeliest}, learned anew, is left: "
                f"{left}",
                "check that data and body are of one robot, in one unit, each marker under its own "
                f"name; {WHERE_TO_LOOK}",
            ]
        if not report.sure:
            reasons.append("few poses since: the cause may be another, record 10 or more")
    elif against.too_many:
        reasons = [f"{against.words}, and no one change explains them: {WHERE_TO_LOOK}"]
    elif report.misfit.too_large:
        reasons = [
            f"{report.misfit.words}, and no one change that is looked for explains it: a gear, a "
            "lens, or something that moved a little, or noise that is louder; ask `evaluate`, and "
            "learn the body anew if it says FAIL"
        ]
    elif against.count:
        reasons.append(against.words)
    return reasons


def _sample(report: HealthReport, row: int | None) -> int | None:
    return None if row is None else int(report.sample[row])
