"""The mirror test: what its report says of trials, and one short run of the command."""

import json
import re
from dataclasses import replace

import numpy as np
import pytest

from nico_selfmodel.errors import EstimationError
from nico_selfmodel.estimation.contingency.body_or_room import BodyOrRoom
from nico_selfmodel.estimation.contingency.contingency import (
    CANNOT_TELL,
    NOBODY,
    NOT_ME,
    ODDS,
    SELF,
    Contingency,
)
from nico_selfmodel.estimation.contingency.image_witness import ImageVerdict
from nico_selfmodel.estimation.contingency.motion_response import MotionResponse
from nico_selfmodel.estimation.mirrors.mark_place import NOT_ON_ME, ON_GLASS, ON_ME
from nico_selfmodel.experiments.mirror_test import report, robots_apart
from nico_selfmodel.experiments.mirror_test import stages as the_stages
from nico_selfmodel.experiments.mirror_test.body_or_room import TurningStage
from nico_selfmodel.experiments.mirror_test.encounters import EXPECTED, EncounterStage, Trial
from nico_selfmodel.experiments.mirror_test.images import ALLOWED, ImageStage, ImageTrial
from nico_selfmodel.experiments.mirror_test.marks import MarkStage, MarkTrial, Watched
from nico_selfmodel.experiments.mirror_test.marks_report import marks_documents, marks_tables
from nico_selfmodel.experiments.mirror_test.painting import (
    KINDS,
    MARK,
    ON_THE_GLASS,
    OTHER_ROBOT,
    SEEN_DIRECTLY,
    SHAM_PAINT,
    Painted,
)
from nico_selfmodel.experiments.mirror_test.report import report_of
from nico_selfmodel.experiments.mirror_test.robots_apart import together
from nico_selfmodel.experiments.mirror_test.stages import MirrorTest
from nico_selfmodel.experiments.mirror_test.structure import LinkStructure, StructureStage
from nico_selfmodel.experiments.mirror_test.touches import TouchStage
from nico_selfmodel.experiments.mirror_test.unknown_mirror import (
    HAND,
    WHOLE,
    MirrorPlace,
    MirrorsStage,
)
from nico_selfmodel.experiments.mirror_test.unmarked import (
    LIGHTS,
    Look,
    PaintsOff,
    UnmarkedStage,
)
from nico_selfmodel.experiments.mirror_test.unmarked_report import unmarked_document
from nico_selfmodel.geometry.triangle_mesh import TriangleMesh
from nico_selfmodel.sessions.looks.expecting import MirrorLook
from nico_selfmodel.sessions.looks.finding import Finding
from nico_selfmodel.sessions.mirrors.knowing import MARKED, Refusal
from nico_selfmodel.sessions.turning import TurnedLook
from nico_selfmodel.systems.rendering.mark_on_body import Mark
from nico_selfmodel.systems.simulated.imperfections import imperfections_named
from nico_selfmodel.vision.surprise.surprise import Expectation, Surprise

from ..slow_rest import slow_rest

RATES = [[0.01, 0.3, 0.5], [0.3, 0.5, 0.5], [0.5, 0.5, 0.99]]
RESPONSE = MotionResponse(0.05, 1, np.array(RATES), 0.01, 0.5, 0.1, 0.8)


@pytest.fixture(autouse=True)
def draws_only_what_is_written(request, monkeypatch):
    """Leave out the chart of encounters, most of what a report costs, where nothing is written."""
    if "tmp_path" not in request.fixturenames:
        monkeypatch.setattr(report, "encounters_chart", lambda _: None)


def said(verdict, seconds=1.0):
    """Return a verdict that fell after some time."""
    top = 0.0 if verdict == CANNOT_TELL else np.log(ODDS) * (1.0 if verdict == SELF else -1.0)
    return Contingency(verdict, seconds, True, np.linspace(0.0, 1.001 * top, round(seconds / 0.05)))


def stage(count, **exceptions):
    """Return a stage in which all is told rightly, but for some encounters."""
    names = [name for name in EXPECTED for _ in range(count)]
    trials = [Trial(name, said(EXPECTED[name])) for name in names]
    for name, found in exceptions.items():
        at = names.index(name.replace("_", " "))
        trials[at] = Trial(names[at], found)
    return EncounterStage(tuple(trials), {0: RESPONSE}, {0: 0.07})


def test_a_hundred_right_verdicts_in_time_pass():
    document = report_of(MirrorTest(stage(15))).document
    assert [(one["stage"], one["status"]) for one in document["stages"]] == [("1", "PASS")]


def test_a_test_that_lacks_a_stage_is_no_pass():
    document = report_of(MirrorTest(stage(15), images(5), turning(5), mirrors(10))).document
    assert {one["status"] for one in document["stages"]} == {"PASS"}
    assert document["status"] == "NOT_EVALUATED"
    assert document["reasons"][0] == "stage 3: it was not begun"


def test_few_trials_are_no_pass():
    assert report_of(MirrorTest(stage(2))).document["status"] == "NOT_EVALUATED"


@pytest.mark.parametrize(
    ("exceptions", "reason"),
    slow_rest(
        [
            ({"mirror": said(NOT_ME)}, "mirror: 1 of 15 verdicts are wrong"),
            ({"other_robot": said(SELF)}, "other robot: 1 of 15 verdicts are wrong"),
            ({"other_robot": said(NOBODY)}, "other robot: 1 of 15 verdicts are wrong"),
            ({"mirror": said(SELF, 6.0)}, "6.0 s, at most 5 s"),
            ({"other_robot": said(NOT_ME, 11.0)}, "other robot: 11.0 s, at most 10 s"),
            ({"mirror": said(CANNOT_TELL, 10.0)}, "1 of 15 could not be told"),
        ],
        plain=2,
    ),
)
def test_one_wrong_late_or_missing_verdict_fails_and_is_named(exceptions, reason):
    document = report_of(MirrorTest(stage(15, **exceptions))).document
    assert document["status"] == "FAIL"
    assert reason in document["reasons"][0]


def test_when_odds_of_a_hundred_were_reached_for_good_is_told_beside_the_verdict():
    top = 1.001 * np.log(ODDS)
    odds = np.concatenate([np.full(10, top - 0.1), np.zeros(29), np.full(40, 0.9 * top), [top]])
    fell = Contingency(SELF, len(odds) * 0.05, True, odds)
    document = report_of(MirrorTest(stage(1, mirror=fell))).document
    rows = {row["encounter"]: row for row in document["stages"][0]["encounters"]}
    assert rows["mirror"]["longest_s"] == pytest.approx(4.0)
    assert rows["mirror"]["longest_to_100_s"] == pytest.approx(2.0)
    assert rows["nobody"]["longest_to_100_s"] == pytest.approx(0.5, abs=0.06)


def test_robots_of_several_processes_are_judged_as_one_test():
    parts = [MirrorTest(stage(8), mirrors=MirrorsStage(())), MirrorTest(stage(7), error="no place")]
    whole = together(parts)
    assert len(whole.encounters.trials) == 7 * 15
    assert whole.mirrors is None  # one of them did not come to it
    assert whole.error == "no place"
    assert report_of(together(parts[:1])).document["stages"][0]["status"] == "NOT_EVALUATED"
    assert report_of(replace(whole, error=None)).document["stages"][0]["status"] == "PASS"


@pytest.mark.parametrize(("missed", "touched"), [(2, True), (3, False)])
def test_marks_that_are_missed_end_a_test_by_all_of_its_robots_together(missed, touched):
    """Two of the 26 marks of one process are too many for it, and not for 52 of both."""
    trials = marked(26).trials
    marks = [one for one in trials if one.painted.kind == MARK][:26]
    rest = [one for one in trials if one.painted.kind != MARK]
    sound = MarkStage((*marks, *rest), None)
    lost = [replace(one, found=()) for one in marks[:missed]]
    poor = MarkStage((*lost, *marks[missed:], *rest), None)
    ending = TouchStage((), (), 0)
    parts = [MirrorTest(stage(8), marks=own, touches=ending) for own in (poor, sound)]
    assert the_stages.marks_fail(poor)
    assert (together(parts).touches is not None) is touched


@pytest.mark.parametrize(("count", "goes_on"), [(150, True), (20, False)])
def test_looks_that_surprise_end_a_test_by_all_of_its_robots_together(count, goes_on):
    """One look of 60 is too many for one process, and not if the other has enough without any."""
    parts = [
        MirrorTest(stage(8), unmarked=one, marks=marked(26), touches=TouchStage((), (), 0))
        for one in (looks(60, 1), looks(count, 0))
    ]
    whole = together(parts)
    assert (whole.marks is not None) is (whole.touches is not None) is goes_on


@pytest.mark.parametrize("share", [True, False])
def test_a_share_of_the_robots_touches_its_marks_however_many_it_missed(monkeypatch, share):
    passed, asked = {"status": "PASS"}, []
    for name in ("images_document", "encounters_document"):
        monkeypatch.setattr(the_stages, name, lambda _: passed)
    failed = {"status": "FAIL"}
    monkeypatch.setattr(the_stages, "unmarked_document", lambda _: failed if share else passed)
    monkeypatch.setattr(the_stages, "marks_documents", lambda _: [passed, failed])
    for name in ("run_images", "run_unmarked", "run_marks"):
        monkeypatch.setattr(the_stages, name, lambda *_: None)
    monkeypatch.setattr(the_stages, "run_structure", lambda *_: StructureStage((), 0))
    monkeypatch.setattr(the_stages, "know_mirrors", lambda *_: (("known",), ()))
    monkeypatch.setattr(the_stages, "place_mirrors", lambda *_: mirrors(2))
    monkeypatch.setattr(the_stages, "run_touches", lambda *_: asked.append("touches"))
    the_stages._go_on({"encounters": None}, [], 1, 8, None, None, share)
    assert asked == (["touches"] if share else [])


@pytest.mark.parametrize("share", [0, 1])
def test_a_share_whose_robots_all_refuse_their_mirrors_does_not_end_the_test_of_the_others(share):
    refused = MirrorsStage((), (Refusal(7, "mirror 'turned' shows 40 % otherwise"),))
    parts = [MirrorTest(stage(8), mirrors=mirrors(2), unmarked=looks(9, 0))]
    parts.insert(share, MirrorTest(stage(8), mirrors=refused))
    whole = together(parts)
    assert whole.unmarked is not None
    assert len(whole.unmarked.looks) == 9
    assert whole.mirrors.refusals == refused.refusals
    assert together([parts[share]] * 2).unmarked is None
    # One that ended before it had mirrors is missing.
    assert together([*parts, MirrorTest(stage(8))]).unmarked is None


def test_looks_and_colours_of_several_processes_are_kept():
    off = PaintsOff(7, *np.zeros((3, 1)))
    parts = [MirrorTest(stage(8), unmarked=replace(looks(9, 0), paints=(off,)))] * 2
    found = together(parts).unmarked
    assert found is not None
    assert (len(found.looks), len(found.paints)) == (18, 2)


@pytest.mark.parametrize(
    ("robots", "trials", "marks", "processes", "dealt"),
    [
        (5, 100, 104, 2, 2),
        (5, 100, 104, 9, 5),
        (4, 100, 18, 4, 2),  # nine kinds of trials with marks each
        (4, 14, 104, 3, 2),  # seven kinds of encounters each
        (2, 7, 9, 2, 1),
    ],
)
def test_no_more_processes_share_robots_than_trials_suffice_for(
    robots, trials, marks, processes, dealt
):
    shares = robots_apart.shares_of(robots, trials, marks, processes)
    assert len(shares) == dealt
    assert [one[0] for one in shares] == [0, *(one[1] for one in shares[:-1])]
    assert shares[-1][1] == robots
    assert sum(one[2] for one in shares) == trials
    assert sum(one[3] for one in shares) == marks


def test_not_me_is_no_mistake_where_nobody_is():
    test = MirrorTest(stage(15, nobody=said(NOT_ME)))
    assert report_of(test).document["stages"][0]["status"] == "PASS"


@pytest.mark.slow
def test_tables_chart_and_json_are_written(tmp_path):
    report_of(MirrorTest(stage(2))).write(tmp_path / "out")
    found = {path.name for path in (tmp_path / "out").iterdir()}
    assert found == {"tables.md", "contingency.png", "result.json", "report.html"}
    page = (tmp_path / "out" / "report.html").read_text("utf-8")
    assert "NOT EVALUATED" in page
    # The chart breaks long labels into lines.
    assert re.search(r"own motion 0.1\s*(</text>.*?<text[^>]*>)?\s*s late", page, re.DOTALL)
    assert 'src="http' not in page
    text = (tmp_path / "out" / "tables.md").read_text("utf-8")
    assert "| own motion 0.1 s late | not me | 2 |" in text
    assert "No other stage is part of this test" in text
    document = json.loads((tmp_path / "out" / "result.json").read_text("utf-8"))
    assert len(document["stages"][0]["encounters"]) == 7


def looks(count, surprised):
    """Return looks at an unmarked body, some of which surprise."""
    nothing = np.zeros((4, 4))
    picture = np.zeros((4, 4, 3), np.uint8)
    one = MirrorLook(
        "left",
        picture,
        Expectation(picture, nothing, 2.0, 0.0),
        Surprise(nothing, 1.0),
        (),
        nothing.astype(int),
        np.zeros(4),
        nothing,
    )
    found = [
        Look(0, LIGHTS[k % 3], (0.9, 0.9), (100, 100), (3.0, 3.0), int(k < surprised))
        for k in range(count)
    ]
    return UnmarkedStage(tuple(found), (one, replace(one, side="right")))


@pytest.mark.parametrize(
    ("count", "surprised", "status"),
    [
        (100, 0, "PASS"),
        (100, 1, "PASS"),
        (100, 2, "FAIL"),
        (99, 0, "NOT_EVALUATED"),
        (9, 1, "FAIL"),
    ],
)
def test_an_unmarked_body_may_surprise_once_in_a_hundred_looks(count, surprised, status):
    document = unmarked_document(looks(count, surprised))
    assert document["status"] == status
    assert f"{surprised} of {count} looks" in document["reasons"][0]
    assert "the hand that moves" in document["not_judged"][0]


def test_a_look_that_surprises_is_named_with_its_link_and_pixel():
    one = looks(3, 1)
    named = replace(one.looks[0], where=("left: neck at 12, 34",))
    document = unmarked_document(UnmarkedStage((named, *one.looks[1:]), one.shown))
    assert document["surprising"] == [{"robot": 0, "light": 1.0, "where": ["left: neck at 12, 34"]}]


def mirrors(count, **off):
    """Return a stage of so many mirrors, one of which is off by something else."""
    places = [
        MirrorPlace(by, np.radians(0.05), 1e-4, 3.0) for by in (HAND, WHOLE) for k in range(count)
    ]
    return MirrorsStage((replace(places[0], **off), *places[1:-1], replace(places[-1], **off)))


@pytest.mark.parametrize(
    ("count", "off", "status", "reason"),
    [
        (10, {}, "PASS", "10 mirrors are at most 0.05 deg and 0.10 mm off"),
        (9, {}, "NOT_EVALUATED", "10 mirrors are needed"),
        (10, {"angle": np.radians(0.09)}, "PASS", "0.09 deg"),
        (10, {"angle": np.radians(0.11)}, "FAIL", "head and chest 1 of 10 mirrors are more than"),
        (10, {"angle": np.radians(0.31)}, "FAIL", "by its hand 1 of 10 mirrors are more than 0.3"),
        (10, {"distance": -0.49e-3}, "PASS", "0.49 mm"),
        (4, {"distance": -0.51e-3}, "FAIL", "0.1 deg or 0.5 mm off"),
        (10, {"distance": -2.1e-3}, "FAIL", "0.3 deg or 2 mm off"),
    ],
)
def test_a_mirror_must_be_where_the_robot_says(count, off, status, reason):
    report = report_of(MirrorTest(stage(15), mirrors=mirrors(count, **off)))
    assert [one["stage"] for one in report.document["stages"]] == ["1", "2"]
    found = report.document["stages"][1]
    assert found["status"] == status
    assert reason in found["reasons"][0]
    assert report.tables[1].rows[1][-1] == "1.00"


def _mirror_px(word):
    """Return how far off the best mirror is, nan where there is none."""
    return 1.0 if word == "a mirror" else np.nan


def turning(robots, *, wrong=0, untold=0):
    """Return a stage of so many robots; of a hundred cells some are told wrongly, or not at all."""
    true = np.arange(100).reshape(10, 10) < 40
    odds = np.where(true, 9.0, -9.0)
    odds.flat[:untold] = 0.0
    none, everything = np.zeros((10, 10), dtype=bool), np.ones((10, 10), dtype=bool)
    looks = {}
    for seed in range(robots):
        mine = odds.copy()
        mine.flat[untold : untold + (wrong if seed == 0 else 0)] *= -1.0
        torso, neck = BodyOrRoom(mine), BodyOrRoom(np.full((10, 10), -9.0))
        picture = np.zeros((160, 160, 3), dtype=np.uint8)
        looks[seed] = tuple(
            TurnedLook(name, "left", picture, everything, told, body, ~body)
            for name, told, body in (("torso", torso, true), ("neck", neck, none))
        )
    return TurningStage(looks)


@pytest.mark.parametrize(
    ("robots", "how", "status", "reason"),
    [
        (5, {}, "PASS", "1000 of 1000 cells are told rightly, 200 of 200 of the body"),
        (4, {}, "NOT_EVALUATED", "4 of 5 robots that are needed"),
        (5, {"wrong": 10}, "PASS", "990 of 1000"),
        (5, {"wrong": 11}, "FAIL", "11 of 1000 cells are told wrongly, at most 1% may be"),
        (5, {"untold": 20}, "PASS", "100 of 200 of the body"),
        (5, {"untold": 21}, "FAIL", "95 of 200 cells of the body are told, 50% are needed"),
    ],
)
def test_what_turns_along_must_be_told_rightly_by_most_of_what_shows_it(
    robots, how, status, reason
):
    report = report_of(MirrorTest(stage(15), images(5), turning(robots, **how)))
    found = report.document["stages"][2]
    assert (found["stage"], found["status"]) == ("1c", status)
    assert reason in found["reasons"][0]
    assert "turning" in report.charts


def test_what_several_processes_told_of_torsos_is_put_together():
    parts = [
        MirrorTest(stage(8), images(5), turning(2)),
        MirrorTest(stage(7), images(5), turning(3)),
    ]
    parts[1] = replace(
        parts[1], turning=TurningStage({k + 2: v for k, v in turning(3).looks.items()})
    )
    whole = together(parts)
    assert whole.turning is not None
    assert sorted(whole.turning.looks) == [0, 1, 2, 3, 4]


def images(count, **said_of):
    """Return a stage of so many images of each kind, the last of which is told otherwise."""
    trials = []
    for shown, allowed in ALLOWED.items():
        words = [allowed[0]] * (count - 1) + [said_of.get(shown.split()[0], allowed[-1])]
        trials += [
            ImageTrial(shown, ImageVerdict(word, 12, 20.0, 4.0, 25.0, _mirror_px(word), 9.0))
            for k, word in enumerate(words)
        ]
    return ImageStage(tuple(trials))


@pytest.mark.parametrize(
    ("count", "said_of", "status", "reason"),
    [
        (5, {}, "PASS", "5 of each are told rightly"),
        (4, {}, "NOT_EVALUATED", "5 are needed"),
        (5, {"twin": "cannot tell"}, "PASS", "rightly"),
        (5, {"twin": "a mirror"}, "FAIL", "twin that imitates at once: 1 of 5 are told wrongly"),
        (5, {"live": "a mirror"}, "FAIL", "live picture of itself: 1 of 5"),
        (4, {"live": "cannot tell"}, "FAIL", "live picture of itself: 1 of 4"),
        (5, {"mirror": "cannot tell"}, "FAIL", "mirror: 1 of 5"),
    ],
)
def test_what_moves_with_oneself_must_be_told_by_where_it_is(count, said_of, status, reason):
    report = report_of(MirrorTest(stage(15), images(count, **said_of)))
    found = report.document["stages"][1]
    assert (found["stage"], found["status"]) == ("1b", status)
    assert reason in found["reasons"][0]
    assert f"| mirror | {count} |" in report.tables[1].markdown


def test_a_twin_that_no_mirror_explains_and_images_that_nobody_saw_can_be_written(tmp_path):
    nan = float("nan")
    unseen = ImageTrial("twin that imitates at once",
                        ImageVerdict("cannot tell", 3, nan, nan, nan, nan, nan))  # fmt: skip
    told = ImageStage((*images(5).trials, unseen))
    report_of(MirrorTest(stage(15), told)).write(tmp_path / "out")
    document = json.loads((tmp_path / "out" / "result.json").read_text("utf-8"))
    twin = document["stages"][1]["images"][-1]
    assert twin["mirror_px"] == [None] * 6
    assert twin["depth_mm"][-1] is None


def test_the_report_tells_what_learned_colours_are_off_by():
    off = PaintsOff(7, np.array([0.1, 0.05]), np.array([0.004, 0.002]), np.array([0.003, 0.002]))
    report = report_of(
        MirrorTest(
            stage(15),
            images(5),
            turning(5),
            mirrors(10),
            unmarked=replace(looks(9, 0), paints=(off,)),
        )
    )
    (table,) = (one for one in report.tables if "colours of its paints" in one.title)
    assert table.rows == [["7", "2", "7.5 %", "0.3 %", "0.4 %", "0.2 %"]]
    (found,) = (one for one in report.document["stages"] if one["stage"] == "4")
    assert found["paints"][0]["learned_off"] == [0.004, 0.002]


def test_a_link_of_which_nothing_was_learned_can_be_written(tmp_path):
    mesh = TriangleMesh(np.zeros((0, 3)), np.zeros((0, 3), dtype=int))
    nothing = LinkStructure(
        7, "head", mesh, np.zeros(0), np.zeros((0, 3)), np.zeros(0), 0.0, 0.0, 0.0
    )
    report = report_of(
        MirrorTest(stage(15), images(5), turning(5), mirrors(10), StructureStage((nothing,), 9))
    )
    document = json.loads(json.dumps(report.document, allow_nan=False))
    assert document["stages"][4]["status"] == "FAIL"
    assert document["stages"][4]["links"][0]["median_mm"] is None


def test_an_error_in_a_later_stage_fails_it_and_keeps_what_went_before():
    report = report_of(
        MirrorTest(stage(15), images(5), turning(5), mirrors(10), error="no such place")
    )
    stages = report.document["stages"]
    assert [(one["stage"], one["status"]) for one in stages] == [
        ("1", "PASS"), ("1b", "PASS"), ("1c", "PASS"), ("2", "PASS"), ("3", "FAIL"),
    ]  # fmt: skip
    assert report.document["status"] == "FAIL"
    # What fails it comes first.
    assert report.document["reasons"][0] == "stage 3: no such place"


@pytest.mark.parametrize("error", [EstimationError("no place"), RuntimeError("no distance")])
def test_an_error_of_one_stage_loses_nothing_of_those_before_it(monkeypatch, caplog, error):
    """Whether the package raised it, or a library in it."""

    def images(*_):
        raise error

    monkeypatch.setattr(the_stages, "acquainted", lambda *_: [])
    monkeypatch.setattr(the_stages, "run_encounters", lambda *_: stage(15))
    monkeypatch.setattr(the_stages, "run_images", images)
    test = the_stages.run_stages(imperfections_named("thesis"), [1], 100, 3, 9)
    document = report_of(test).document
    assert document["status"] == "FAIL"
    assert [one["status"] for one in document["stages"]] == ["PASS", "FAIL"]
    assert str(error) in document["stages"][1]["reasons"][0]
    traced = [one.exc_info for one in caplog.records]
    assert bool(traced) == (type(error) is RuntimeError)


def test_a_robot_that_finds_no_shape_fails_the_third_stage_alone():
    nothing = StructureStage((), 14, (Refusal(7, "no shape of its arm: 5 poses show the hand"),))
    report = report_of(
        MirrorTest(stage(15), images(5), turning(5), mirrors(10), nothing, unmarked=looks(100, 0))
    )
    stages = {one["stage"]: one for one in report.document["stages"]}
    assert stages["3"]["status"] == "FAIL"
    assert stages["3"]["reasons"] == ["robot 7 learned no shape of its arm: 5 poses show the hand"]
    assert stages["4"]["status"] == "PASS"


@pytest.mark.parametrize("learned", [0, 10])
def test_a_robot_that_does_not_trust_its_mirror_ends_the_test_with_what_it_says(learned):
    places = mirrors(learned).places if learned else ()
    refused = MirrorsStage(places, (Refusal(7, "mirror 'turned' shows 40 % otherwise"),))
    report = report_of(MirrorTest(stage(15), mirrors=refused))
    assert report.document["status"] == "FAIL"
    assert report.document["reasons"][0].startswith(
        "stage 2: robot 7 does not trust a mirror: mirror 'turned' shows 40 %"
    )


def test_both_stages_are_in_one_report_and_the_worse_status_counts():
    report = report_of(MirrorTest(stage(15), unmarked=looks(30, 0)))
    assert [one["status"] for one in report.document["stages"]] == ["PASS", "NOT_EVALUATED"]
    assert report.document["status"] == "NOT_EVALUATED"
    assert set(report.charts) == {"contingency", "surprise"}
    assert "| 0.9 | 10 | 0 | 0.900 | 100 | 0 | 1.00 |" in "".join(t.markdown for t in report.tables)


RED = np.array([1.0, 0.0, 0.0])
SAYS = {MARK: ON_ME, ON_THE_GLASS: ON_GLASS, OTHER_ROBOT: NOT_ON_ME, SEEN_DIRECTLY: ON_ME}


def found(kind, off=1e-3, link="head"):
    """Return what is said of a mark, its place off by sqrt(2) sigma along x."""
    if kind != ON_ME:
        return Finding(kind, None, None, None, ())
    covariance = np.eye(3) * off**2 / 2.0
    return Finding(ON_ME, link, np.array([off, 0.0, 0.0]), covariance, ())


def marked(count, says=None, after=()):
    """Return trials that are answered rightly, but for the first of some kinds."""
    trials = []
    for kind in (MARK, *KINDS):
        for k in range(count if kind == MARK or kind in SAYS else count // 2 + 1):
            painted = Painted(kind, Mark("head", np.zeros(3), 0.01, RED), np.array([0.0, 0.0, 1.0]))
            said = (found(SAYS[kind]),) if kind in SAYS else ()
            if says and kind in says and k == 0:
                said = says.pop(kind)
            trials.append(MarkTrial(0, painted, said, after if kind == MARK else None))
    return MarkStage(tuple(trials), None)


def statuses(stage):
    return {one["stage"]: one["status"] for one in marks_documents(stage)}


def test_marks_found_where_they_are_and_controls_answered_rightly_pass():
    assert statuses(marked(13)) == {"5": "PASS", "5b-d": "NOT_EVALUATED", "6": "PASS", "8": "PASS"}
    assert statuses(marked(25)) == dict.fromkeys(("5", "5b-d", "6", "8"), "PASS")
    assert set(statuses(marked(2)).values()) == {"NOT_EVALUATED"}


@pytest.mark.parametrize(
    ("wrong", "stage", "reason"),
    [
        ({SHAM_PAINT: (found(ON_ME),)}, "5b-d", "sham, own colour: 1 of 13 are answered wrongly"),
        ({ON_THE_GLASS: ()}, "5b-d", "mark on the glass: 1 of 25"),
        ({OTHER_ROBOT: (found(ON_ME),)}, "5b-d", "mark on another robot: 1 of 25"),
        ({SEEN_DIRECTLY: (found(ON_ME),) * 2}, "5b-d", "mark seen directly, too: 1 of 25"),
        ({SEEN_DIRECTLY: (found(ON_ME, link="chest"),)}, "5b-d", "seen directly, too: 1 of 25"),
        ({SEEN_DIRECTLY: (found(ON_ME), found(NOT_ON_ME))}, "5b-d", "directly, too: 1 of 25"),
        ({MARK: (found(ON_ME, link="chest"),)}, "6", "marks are put on another link"),
    ],
)
def test_a_wrong_answer_fails_its_stage_and_later_ones_are_not_judged(wrong, stage, reason):
    documents = marks_documents(marked(25, says=wrong))
    assert documents[-1]["stage"] == stage
    assert documents[-1]["status"] == "FAIL"
    assert reason in documents[-1]["reasons"][0]


def test_marks_that_are_all_put_on_another_link_fail_though_no_place_is_left_to_judge():
    chest = (found(ON_ME, link="chest"),)
    own = [replace(t, found=chest) if t.painted.kind == MARK else t for t in marked(25).trials]
    last = marks_documents(MarkStage(tuple(own), None))[-1]
    assert (last["stage"], last["status"], last["places"]) == ("6", "FAIL", 0)
    assert last["reasons"] == ["125 of 125 marks are put on another link"]


def test_who_does_not_notice_a_mark_on_another_robot_did_not_take_it_for_its_own():
    documents = marks_documents(marked(25, says={OTHER_ROBOT: ()}))
    assert [one["status"] for one in documents] == ["PASS"] * 4
    rows = {row["control"]: row for row in documents[1]["controls"]}
    assert rows[OTHER_ROBOT]["said"] == {NOT_ON_ME: 24, "nothing": 1}
    wrong = marks_documents(marked(25, says={OTHER_ROBOT: (found(ON_GLASS),)}))
    assert wrong[-1]["stage"] == "5b-d"
    assert wrong[-1]["status"] == "FAIL"


def test_one_missed_mark_of_twenty_is_too_many():
    few = marked(4)
    missed = replace(few.trials[0], found=())
    documents = marks_documents(MarkStage((missed, *few.trials[1:]), None))
    assert documents[-1]["status"] == "FAIL"
    said = "19 of 20 marks are found, and 4 of 4 that are seen directly, too, more than 95 of 100"
    assert said in documents[-1]["reasons"][0]
    first, second, *_ = documents[0]["trials"]
    assert (first["said"], first["off_mm"]) == ("nothing", None)
    assert (second["link"], second["said"], second["off_mm"]) == ("head", "on me", 1.0)


@pytest.mark.parametrize(("lost", "status"), [(7, "PASS"), (8, "FAIL")])
def test_marks_that_are_seen_directly_too_must_be_found_like_all_others(lost, status):
    """No control is answered wrongly by who misses one, but 25 and 125 are 150."""
    trials = list(marked(25).trials)
    own = [k for k, t in enumerate(trials) if t.painted.kind == SEEN_DIRECTLY]
    for k in own[:lost]:
        trials[k] = replace(trials[k], found=())
    first = marks_documents(MarkStage(tuple(trials), None))[0]
    assert (first["status"], first["hits_of_these"]) == (status, 25 - lost)


def test_places_that_are_too_far_off_or_dishonest_fail():
    def all_off(off, share):
        one = found(ON_ME, off)
        one = replace(one, covariance=one.covariance * share)
        own = [replace(t, found=(one,)) if t.painted.kind == MARK else t for t in marked(25).trials]
        return marks_documents(MarkStage(tuple(own), None))[-1]

    assert "places are off by 4.0 mm" in all_off(4e-3, 1.0)["reasons"][0]
    assert "chi-square over 2 is 0.50" in all_off(1e-3, 2.0)["reasons"][0]
    assert all_off(1e-3, 1.0)["status"] == "PASS"


def test_a_mark_seen_after_it_is_gone_fails():
    documents = marks_documents(marked(25, after=(found(ON_ME),)))
    assert documents[-1]["stage"] == "8"
    assert documents[-1]["status"] == "FAIL"


@pytest.mark.parametrize(("changed", "status"), [(None, "PASS"), ("zero of right_elbow", "FAIL")])
def test_a_monitor_that_says_that_the_body_changed_fails_the_last_stage(changed, status):
    seen = replace(marked(25), watched=(Watched(3, 39, None), Watched(4, 40, changed)))
    document = marks_documents(seen)[-1]
    assert (document["stage"], document["status"], document["not_evaluated"]) == ("8", status, [])
    told = "robot 4: its monitor says that something changed: zero of right_elbow"
    said = "the monitor says of 2 bodies that nothing changed"
    assert (told if changed else said) in document["reasons"][0]
    assert document["watched"][0] == {"robot": 3, "poses": 39, "changed": None}
    parts = [MirrorTest(stage(8), marks=one) for one in (seen, marked(2))]
    assert together(parts).marks.watched == seen.watched


def test_marks_on_all_links_of_the_arm_are_one_row():
    arm = [
        replace(one, painted=replace(one.painted, mark=replace(one.painted.mark, link=link)))
        for one, link in zip(marked(2).trials, MARKED[2:], strict=False)
    ]
    text = "".join(table.markdown for table in marks_tables(MarkStage(tuple(arm), None)))
    assert "| arm | 3 | 3 | 3 |" in text
    assert "| chest | 0 | 0 |" in text


def test_the_tables_count_what_was_said():
    watched = (Watched(3, 39, None), Watched(4, 40, "a gear"))
    text = "".join(one.markdown for one in marks_tables(replace(marked(5), watched=watched)))
    assert "| body watched after it | unchanged | 2 | unchanged 1 |" in text
    assert "| mark on the glass | on the glass | 5 | on the glass 5 |" in text
    assert "| mark taken off | nothing | 25 | no mark on me 25 |" in text
    assert "| head | 25 | 25 | 0 | 1.0 | 1.0 | 1.00 |" in text


@pytest.mark.parametrize(
    ("option", "value", "reason"),
    [
        ("--marks", 3, "--marks must be at least 9"),
        ("--glass", "clear", "--glass clear: there are flat, bent, dirty, half"),
        ("--walls", "tiled", "no walls 'tiled'"),
        ("--trials", 3, "--trials must be at least 7"),
    ],
)
def test_too_few_trials_and_glass_or_walls_that_nobody_has_are_refused_in_one_line(
    option, value, reason, tmp_path, command
):
    done = command("experiment", "mirror-test", option, value, "--out", tmp_path / "out")
    assert done.returncode == 2
    assert reason in done.stderr
    assert len(done.stderr.strip().splitlines()) == 1
    assert list(tmp_path.iterdir()) == []


@pytest.mark.slow
def test_one_robot_tells_itself_from_others_and_finds_marks_on_itself(tmp_path, command):
    out = tmp_path / "out"
    done = command("experiment", "mirror-test", "--trials", 7, "--seed", 4, "--out", out)
    assert done.returncode in (0, 1), done.stdout + done.stderr
    document = json.loads((out / "result.json").read_text("utf-8"))
    stages = {one["stage"]: one for one in document["stages"]}
    assert stages["1"]["status"] == stages["4"]["status"] == "NOT_EVALUATED"
    assert all(row["wrong"] == 0 for row in stages["1"]["encounters"])
    links = {row["link"] for row in stages["3"]["links"]}
    assert {"right_forearm", "right_hand"} <= links
    assert links <= {"head", "chest", "right_forearm", "right_hand"}
    assert stages["5"]["marks"] == 4
    assert stages["5"]["hits"] >= 2
    assert {"tables.md", "mark.png", "surprise.png", "arm.png"} <= {
        path.name for path in out.iterdir()
    }
