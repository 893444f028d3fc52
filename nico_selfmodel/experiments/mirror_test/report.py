"""The mirror test as tables, a chart and JSON: each stage that exists against its bounds."""

from nico_selfmodel.estimation.contingency.contingency import ODDS
from nico_selfmodel.experiments.experiment_report import ExperimentReport, Table
from nico_selfmodel.experiments.mirror_test.encounters import EncounterStage
from nico_selfmodel.experiments.mirror_test.encounters_report import (
    encounters_chart,
    encounters_document,
    encounters_table,
)
from nico_selfmodel.experiments.mirror_test.unmarked import UnmarkedStage
from nico_selfmodel.experiments.mirror_test.unmarked_report import (
    unmarked_chart,
    unmarked_document,
    unmarked_table,
)
from nico_selfmodel.sessions.motion_session import PERIOD


def report_of(stage: EncounterStage, unmarked: UnmarkedStage | None = None) -> ExperimentReport:
    """Return the verdicts of the stages, and what they rest on.

    Args:
        stage: The first one.
        unmarked: The fourth one; None where the first failed, so that it was not begun.
    """
    stages = [encounters_document(stage)]
    tables = [encounters_table(stage)]
    charts = {"contingency": encounters_chart(stage)}
    if unmarked is not None:
        stages.append(unmarked_document(unmarked))
        tables.append(unmarked_table(unmarked))
        charts["surprise"] = unmarked_chart(unmarked)
    found = {one["status"] for one in stages}
    document = {
        "status": next(s for s in ("FAIL", "NOT_EVALUATED", "PASS") if s in found),
        "reasons": [
            f"stage {one['stage']}: {reason}" for one in stages for reason in one["reasons"]
        ],
        "stages": stages,
    }
    head = (
        "# The mirror test\n\n"
        f"**{document['status']}**: {'; '.join(document['reasons'])}.\n\n"
        "Stage 1, contingency: whose motion follows one's own? Stage 4, the expected picture: does "
        "an unmarked head and chest look as expected? No other stage is part of this test, and one "
        f"that fails is the last. {len(stage.responses)} simulated robot(s) that learned cameras "
        f"and arm by themselves, {len(stage.trials)} encounters in random order, one camera, a "
        f"picture every {1e3 * PERIOD:.0f} ms; odds of {ODDS:,.0f} to 1 end an encounter.\n\n"
    )
    return ExperimentReport(head, (*tables, _given()), charts, document)


def _given() -> Table:
    """Return what the robot was given, and what it learned."""
    rows = [
        ["arm and cameras", "learned, from pictures of a chessboard and of its own hand"],
        ["delay of its pictures", "learned, from its arm seen directly"],
        ["how surely motion is seen", "learned, likewise"],
        ["names of its links and which follows which", "given, by its description"],
        ["where its head is turned, poses that a mirror shows", "given, by its description"],
        ["where the mirror stands", "learned, from its hand seen in it"],
        ["noise of its pictures, gain of a look", "learned, from its pictures"],
        ["shape and colours of its links", "given, by its description"],
        ["light of the room", "given, but for its brightness"],
        ["what shapes and colours are not known by", "3 mm, 3 %: set on robot 0"],
        ["threshold of a surprising place", "derived: one false place in 100 pictures"],
        ["odds that stop the test", "derived: 100 to 1 that of 100 verdicts not one is wrong"],
        ["threshold of the motion mask", "derived: one false cell in 1000 still pictures"],
    ]
    return Table(
        "What the robot was given, and what it learned", ("what", "from where"), rows, "\n"
    )
