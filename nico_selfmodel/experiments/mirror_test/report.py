"""The mirror test as tables, a chart and JSON: each stage that exists against its bounds."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from nico_selfmodel.estimation.contingency.body_or_room import CHANGES
from nico_selfmodel.estimation.contingency.contingency import ODDS
from nico_selfmodel.experiments.experiment_report import ExperimentReport, Table
from nico_selfmodel.experiments.mirror_test.body_or_room import (
    turning_chart,
    turning_document,
    turning_table,
)
from nico_selfmodel.experiments.mirror_test.encounters_report import (
    encounters_chart,
    encounters_document,
    encounters_table,
)
from nico_selfmodel.experiments.mirror_test.images import images_document, images_table
from nico_selfmodel.experiments.mirror_test.marks_report import (
    marks_chart,
    marks_documents,
    marks_tables,
)
from nico_selfmodel.experiments.mirror_test.stage_document import as_json, stage_document
from nico_selfmodel.experiments.mirror_test.stages import MirrorTest
from nico_selfmodel.experiments.mirror_test.structure_report import (
    structure_charts,
    structure_document,
    structure_table,
)
from nico_selfmodel.experiments.mirror_test.touches import SEEN_ON
from nico_selfmodel.experiments.mirror_test.touches_report import touches_document, touches_table
from nico_selfmodel.experiments.mirror_test.unknown_mirror import (
    mirrors_document,
    mirrors_table,
)
from nico_selfmodel.experiments.mirror_test.unmarked_report import (
    paints_table,
    unmarked_chart,
    unmarked_document,
    unmarked_table,
)
from nico_selfmodel.plant.touching.touch_planner import CLEAR, LEAN, NARROW, WIDE
from nico_selfmodel.sessions.looks.expecting import TURNED
from nico_selfmodel.sessions.looks.least_unknown import COLOR_SIGMA, MOVING
from nico_selfmodel.sessions.looks.mark_finder import LINK_SIGMA, PIXEL_SIGMA
from nico_selfmodel.sessions.looks.seen_arm import EDGE, LOOSE, SHOULDER
from nico_selfmodel.sessions.mirrors.knowing import TRUSTED
from nico_selfmodel.sessions.mirrors.learned_shape import APART
from nico_selfmodel.sessions.motion_session import PERIOD
from nico_selfmodel.sessions.shapes.moving_shape import SHIFT, TURN
from nico_selfmodel.viz.reports.experiment_page import ExperimentPage, text_table
from nico_selfmodel.viz.reports.parts import Drawing, numbers, section

_BEGUN = {
    "images": "1b",
    "turning": "1c",
    "mirrors": "2",
    "structure": "3",
    "unmarked": "4",
    "marks": "5",
    "touches": "7",
}
"""Part of a test -> the stage that it is."""


def _told(test: MirrorTest) -> tuple[list[dict[str, Any]], list[Table], dict[str, Any]]:
    """Return the stages that were begun as plain data, their tables and their charts."""
    stages: list[dict[str, Any]] = [encounters_document(test.encounters)]
    tables = [encounters_table(test.encounters)]
    charts = {"contingency": encounters_chart(test.encounters)}
    if test.images is not None:
        stages.append(images_document(test.images))
        tables.append(images_table(test.images))
    if test.turning is not None:
        stages.append(turning_document(test.turning))
        tables.append(turning_table(test.turning))
        charts["turning"] = turning_chart(test.turning)
    if test.mirrors is not None:
        stages.append(mirrors_document(test.mirrors))
        tables.append(mirrors_table(test.mirrors))
    if test.structure is not None:
        stages.append(structure_document(test.structure))
        tables.append(structure_table(test.structure))
        charts |= structure_charts(test.structure)
    if test.unmarked is not None:
        stages.append(unmarked_document(test.unmarked))
        tables += [unmarked_table(test.unmarked), paints_table(test.unmarked)]
        charts["surprise"] = unmarked_chart(test.unmarked)
    if test.marks is not None:
        stages += marks_documents(test.marks)
        tables += marks_tables(test.marks)
        if test.marks.shown is not None:
            charts["mark"] = marks_chart(test.marks)
    if test.touches is not None:
        stages.append(touches_document(test.touches))
        tables.append(touches_table(test.touches))
    return stages, tables, charts


def report_of(test: MirrorTest) -> ExperimentReport:
    """Return the verdicts of the stages, and what they rest on.

    Args:
        test: What happened in all stages that were begun.
    """
    stages, tables, charts = _told(test)
    if test.error is not None:
        begun = next(k for k in _BEGUN if getattr(test, k) is None)
        stages.append(stage_document(_BEGUN[begun], "ended in an error", [test.error], None, ""))
    found = {one["status"] for one in stages}
    status = next(s for s in ("FAIL", "NOT_EVALUATED", "PASS") if s in found)
    missing = [stage for part, stage in _BEGUN.items() if getattr(test, part) is None]
    # What the verdict rests on comes first.
    told = sorted(stages, key=lambda one: one["status"] != status)
    reasons = [f"stage {one['stage']}: {reason}" for one in told for reason in one["reasons"]]
    if status == "PASS" and missing:  # a test that passes has all of its stages
        status, reasons = "NOT_EVALUATED", [f"stage {missing[0]}: it was not begun", *reasons]
    document = {
        "status": status,
        "reasons": reasons,
        "stages": as_json(stages),
    }
    met = test.encounters
    head = (
        "# The mirror test\n\n"
        f"**{document['status']}**: {'; '.join(document['reasons'])}.\n\n"
        "Stage 1, contingency: whose motion follows one's own? Stage 1b: is what moves with "
        "oneself a mirror, a picture or another? Stage 1c: what of a picture is body, and what is "
        "room, as the torso turns? Stage 2: where "
        "does a mirror stand that was never looked into? Stage 3, structure: what shape have head, "
        "chest, forearm and hand? Stage 4, the expected picture: does an unmarked body look as "
        "expected, its arm included? Stages 5, 6 and 8: is a mark found that is seen in mirrors "
        "only, where is it, and is nothing found where it is not? Stage 7: does the finger touch "
        "it, and nothing else the body? No other stage "
        "is part of this test, and one that fails is the last that is judged, but for stages 1c "
        "and 3: the later ones stand still, and expect to see the description's shapes. "
        f"{len(met.responses)} simulated robot(s) that learned cameras and arm by themselves, "
        f"{len(met.trials)} encounters in random order, both cameras, a picture of each every "
        f"{1e3 * PERIOD:.0f} ms; odds of {ODDS:,.0f} to 1 end an encounter.\n\n"
    )
    page = _page(document, tables, charts)
    return ExperimentReport(head, (*tables, _given()), charts, document, page)


def _page(
    document: Mapping[str, Any], tables: Sequence[Table], charts: Mapping[str, Any]
) -> ExperimentPage:
    """Return the report as a page: the looks first, then every table."""
    about = "Do I look as I expect, and what is on me that was not there?"
    shown = (("mark", "A look at a mark"), ("surprise", "A look at the unmarked body"),
             ("structure", "The shape of head and chest"), ("arm", "The shape of forearm and hand"),
             ("contingency", "Whose motion follows one's own"),
             ("turning", "Body against room"))  # fmt: skip
    drawn = [
        section(title, Drawing(charts[name], title)) for name, title in shown if name in charts
    ]
    told = [
        section(table.title, numbers(text_table(table.headings, table.rows), "cards"))
        for table in (*tables, _given())
    ]
    return ExperimentPage(
        "The mirror test", about, document["status"], tuple(document["reasons"]), (*drawn, *told)
    )


TURNING_CHANGES = "{:g} and {:g}, after each turn: given".format(*CHANGES)
KEPT_OFF = "learned where it was seen (stage 3), beside what its description gives"
DERIVED_SHAPE = "derived: from what mirrors, joints and cameras are known by"
SET_COLOR = f"{100 * COLOR_SIGMA:g} %: set on robots 0 and 1; more where its looks tell"
SET_MIDDLE = f"{PIXEL_SIGMA:g} px: set on robots 900 and 950"
SET_UNLIKE = f"{100 * TRUSTED:g} %: set on robots 1853, 1893, 1894, 1912, 1913 and 1919"
NEAR_AND_LEAN = (
    f"{1e3 * WIDE:.0f}, else {1e3 * CLEAR:.0f} mm, {np.degrees(LEAN):.0f} deg: chosen; "
    f"{1e3 * NARROW:g} mm where there is no other way: set on robots 1853, 1893 and 1894"
)
LINK_APART = f"{1e3 * APART:g} mm: derived from joints' 2 mm, looked at on 1853, 1893 and 1894"
LOOSE_JOINTS = f"{np.degrees(LOOSE):.1f} deg: given"
SET_SHOULDER = f"{1e3 * SHOULDER:g} mm: set on robots 1893 and 1912"
SET_EDGE = f"{EDGE:g} grey levels from pixel to pixel: set on robots 1893 and 1912"
SET_ARM = f"{1e3 * MOVING:g} mm: set on robots 1893 and 1894"
SET_LINK = f"{1e3 * LINK_SIGMA:g} mm: set on robots 1934 to 1951; 1973 to 1979, 1984, 1985"
TURNED_TO_LIGHT = f"{np.degrees(TURNED):g} deg: given"
SET_POSES = f"{1e3 * TURN:g} mrad, {1e3 * SHIFT:g} mm: set on robots 1893 and 1912"
SEEN_BESIDE = f"{1e3 * SEEN_ON:g} mm: set on robot 1893"


def _given() -> Table:
    """Return what the robot was given, and what it learned."""
    rows = [
        ["arm and cameras", "learned, from pictures of a chessboard and of its own hand"],
        ["delay of its pictures", "learned, from its arm seen directly"],
        ["how surely motion is seen", "learned, likewise"],
        ["how often what turns along looks otherwise, and what does not", TURNING_CHANGES],
        ["names of its links and which follows which", "given, by its description"],
        ["where its head is turned, poses that a mirror shows", "given, by its description"],
        ["which way is up", "given: its root stands upright, its cameras as described"],
        ["where the mirrors stand", "learned, from its hand, head and chest seen in them"],
        ["how head and body stand before them", "learned, from head and chest seen in them"],
        ["noise of its pictures, gain of a look", "learned, from its pictures"],
        ["shape of head and chest", "learned, in mirrors (stage 3); touching uses it"],
        ["shape of forearm and hand", "learned, seen directly (stage 3); nothing uses it"],
        ["which link a place of these belongs to", "given: the nearest line between its joints"],
        ["what these shapes are off by in all pictures", DERIVED_SHAPE],
        ["shape of its links in its expected pictures", "given, by its description"],
        ["which of its solids are of one paint", "given, by its description"],
        ["colours of its paints", "learned, from head and chest seen in mirrors"],
        ["what of head and chest the arm keeps off", KEPT_OFF],
        ["shape of its arm as it touches, where its finger is", "given, by its description"],
        ["light of the room", "given, but for its brightness and how the robot is turned in it"],
        ["what places of links are not known by", "learned, from looks at the unmarked body"],
        ["what colours are not known by", SET_COLOR],
        ["what the middle of a spot is not known by besides its fit", SET_MIDDLE],
        ["how much of a body a mirror may show otherwise", SET_UNLIKE],
        ["what is a mirror, a picture or another", "derived, but for 5 px: set on 900 and 950"],
        ["how thick paint may be", "0.2 mm: given"],
        ["threshold of a surprising place", "derived: one false place in 100 pictures"],
        ["how near the arm may come to the body, how far the finger may lean", NEAR_AND_LEAN],
        ["how much nearer than another's its own link's lines must be for a shape", LINK_APART],
        ["how loose its joints are in a look at its arm", LOOSE_JOINTS],
        ["how far its whole arm may stand beside where it was learned, in a look", SET_SHOULDER],
        ["what is an edge of its arm", SET_EDGE],
        ["how its arm stands in a look, where its finger came to", "seen, by the arm's edges"],
        ["what places of its arm's links are not known by in pictures", SET_ARM],
        ["where its arm's links and its trunk stand beside where known to, for a mark", SET_LINK],
        ["how a link of its arm may be turned to the light", TURNED_TO_LIGHT],
        ["by what its arm is wrong beside its joints' noise, for a shape", SET_POSES],
        ["how far beside a mark it is seen and goes again", SEEN_BESIDE],
        ["odds that stop the test", "derived: 100 to 1 that of 100 verdicts not one is wrong"],
        ["threshold of the motion mask", "derived: one false cell in 1000 still pictures"],
    ]
    return Table(
        "What the robot was given, and what it learned", ("what", "from where"), rows, "\n"
    )
