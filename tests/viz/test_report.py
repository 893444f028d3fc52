import base64
import csv
import io
import json
import re

import numpy as np
import pytest

from nico_selfmodel.dataset.folder import content_hash
from nico_selfmodel.estimation.arm.kinematics import calibrate_kinematics
from nico_selfmodel.estimation.judging import judge, to_json
from nico_selfmodel.estimation.results.verdict import Verdict
from nico_selfmodel.viz.reports.arm import arm_report

from .conftest import JOINTS, OUTLIERS, poses, recorded
from .page import LOADING, Page


@pytest.fixture(scope="module")
def page(html):
    return Page(html)


@pytest.fixture
def undrawn(monkeypatch):
    """Leave the figures empty, for tests of what stands around them."""
    monkeypatch.setattr("nico_selfmodel.viz.figures.plot_style.image_bytes", lambda *_: b"<svg/>")


def numbers_in(value):
    if isinstance(value, dict):
        return [n for entry in value.values() for n in numbers_in(entry)]
    return [] if value is None or isinstance(value, bool | str | list) else [float(value)]


def test_the_verdict_comes_first_with_its_reasons(page, verdict):
    body = page.text[page.text.index("PASS", page.text.index("learned about themselves")) :]
    assert body.startswith("PASS\n")
    assert verdict.reasons[0] in body[:200]
    ids = [attributes["id"] for _, attributes in page.tags if "id" in attributes]
    assert ids[0] == "verdict"


def test_the_statistics_are_those_of_the_result_to_the_last_digit(page, document):
    parts = [document[key] for key in ("test", "cross_validation", "train")]
    wanted = [n for part in parts for n in (part["n"], *numbers_in(part["position_mm"]))]
    assert len(wanted) == 21
    assert set(wanted) <= set(page.values)


def test_every_parameter_is_listed_as_in_the_result(page, document):
    for name, entry in document["parameters"].items():
        assert name in page.words
        assert entry["value"] in page.values
        assert repr(entry["value"]) in page.words


def test_a_person_reads_one_row_a_joint_in_millimetres_and_degrees(page, document):
    start = page.words.index("θ offset [deg]")
    for joint in JOINTS:
        row = page.words[page.words.index(joint, start) :]
        offset = document["parameters"][f"{joint}.theta_offset"]
        shown = float(row[3].replace("−", "-"))
        assert shown == pytest.approx(np.degrees(offset["value"]), abs=0.6)
        assert row[4].startswith("±" if offset["free"] else "fixed")


def test_the_mean_error_is_also_a_fraction_of_the_arm(page, document):
    assert "mean / arm" in page.words
    (length,) = re.search(r"The arm, as learned, is ([\d.]+) mm long", page.text).groups()
    share = document["test"]["position_mm"]["mean"] / float(length)
    assert f"{share:.4f}" in page.words


def test_outliers_circles_starts_and_provenance_are_told(page, document, training):
    for sample in OUTLIERS:
        assert str(sample) in page.words
    for circle in document["circles"]:
        assert circle["radius_mm"] in page.values
    assert f"{document['starts']['agreeing']} of {document['starts']['tried']} starts" in page.text
    assert content_hash(training) in page.words
    assert "None: every free parameter is determined." in page.words


def test_there_is_a_figure_for_each_question(page):
    figures = [attributes for tag, attributes in page.tags if tag == "figure"]
    assert len(figures) == 6
    assert all(figure["aria-label"] for figure in figures)
    assert not [tag for tag, _ in page.tags if tag == "img"]


def test_what_is_written_in_figures_is_text_of_the_page(page):
    for words in ("error of a point [mm] ● mean ◆ rms", "share of the points [%]", "angle [deg]"):
        assert words in page.words, words


def test_residuals_are_there_to_download_to_the_last_digit(page, calibration, document):
    (link,) = [a for tag, a in page.tags if tag == "a" and "download" in a]
    kind, _, content = link["href"].partition(",")
    assert (kind, link["download"]) == ("data:text/csv;base64", "residuals.csv")
    rows = list(csv.DictReader(io.StringIO(base64.b64decode(content).decode())))
    errors = {
        name: [float(row["error_mm"]) for row in rows if row["set"] == name]
        for name in ("held-out", "training")
    }
    assert np.mean(errors["held-out"]) == pytest.approx(document["test"]["position_mm"]["mean"])
    assert errors["training"] == pytest.approx((1e3 * calibration.train.distances).tolist())
    measured, predicted = (
        np.array([[float(row[f"{axis}{end}"]) for axis in "xyz"] for row in rows])
        for end in ("_m", "_predicted_m")
    )
    distances = 1e3 * np.linalg.norm(measured - predicted, axis=1)
    assert distances == pytest.approx([float(row["error_mm"]) for row in rows])
    assert {row["sample"] for row in rows if row["outlier"] == "yes"} == set(map(str, OUTLIERS))


def test_correlations_and_starts_are_folded(html):
    for summary in ("Correlations", r"\d+ starts"):
        assert re.search(rf"<details><summary>{summary}</summary>", html), summary


@pytest.mark.parametrize("part", ["page", "scene"])
def test_nothing_is_loaded_from_anywhere(page, part):
    shown = page if part == "page" else Page(page.scene)
    for tag, attributes in shown.tags:
        for name in LOADING & set(attributes):
            assert attributes[name].startswith(("data:", "#")), (tag, name, attributes[name][:80])
        assert "url(" not in attributes.get("style", "")
    assert not {tag for tag, _ in shown.tags} & {"link", "base", "object", "embed"}
    styles = re.findall(r"<style>(.*?)</style>", page.scene if part == "scene" else "", re.DOTALL)
    assert not any("url(" in style or "@import" in style for style in styles)


def test_the_page_takes_less_than_two_megabytes(html):
    assert len(html) < 2e6


@pytest.mark.slow
def test_the_page_of_a_thousand_poses_takes_less_than_two_megabytes():
    rng = np.random.default_rng(9)
    many = calibrate_kinematics(recorded("many", *poses(25, 900, rng), rng))
    assert len(many.train.observations) > 1000
    assert len(arm_report(many, to_json(many, judge(many))).html()) < 2e6


def test_the_page_itself_names_no_address_and_runs_no_script(html, page):
    outside = html.replace("&#39;", "'").split("srcdoc=")[0]
    assert "http" not in outside
    assert "@import" not in outside
    assert set(re.findall(r"url\((.)", outside)) <= {"#"}
    assert not [tag for tag, _ in page.tags if tag == "script"]


def test_the_legend_stands_beside_the_scene(page):
    assert "joint elbow" in page.words
    assert any("residuals, drawn ×" in word for word in page.words)
    assert "set_object" not in page.text
    assert "MeshCat" in page.scene


def test_a_failure_is_red_and_says_why(failed_html, failed):
    page = Page(failed_html)
    (body,) = [attributes for tag, attributes in page.tags if tag == "body"]
    assert body["class"] == "FAIL"
    color = re.search(r"\.FAIL \{ --signal: #([0-9a-f]{6})", failed_html).group(1)
    red, green, blue = (int(color[i : i + 2], 16) for i in (0, 2, 4))
    assert red > 150 > 80 > max(green, blue)
    assert "FAIL" in page.words
    assert any("cannot be told from" in word for word in page.words)
    cells = [attributes for tag, attributes in page.tags if tag == "td"]
    unobservable = [
        cell for cell in cells if cell.get("class") == "unobservable" and "data-value" in cell
    ]
    assert (
        len(unobservable)
        >= len({name for way in failed.uncertainty.unobservable for name in way.names})
        > 1
    )


@pytest.mark.slow
@pytest.mark.usefixtures("undrawn")
def test_names_from_outside_stay_text(renamed):
    verdict = judge(renamed)
    html = arm_report(renamed, to_json(renamed, verdict)).html()
    page = Page(html)
    assert "<script>alert(1)</script>" in page.words
    assert "a<b>" in page.words
    assert not [tag for tag, _ in page.tags if tag in {"script", "i>hand<"}]
    assert "<script>alert(1)" not in html
    assert "<script>alert(1)" not in page.scene


def test_backticks_in_reasons_become_code_and_names_stay_escaped(failed_html):
    page = Page(failed_html)
    assert "too <b>little</b> `data`" in page.words
    assert "`roll" not in page.text


@pytest.mark.slow
@pytest.mark.usefixtures("undrawn")
def test_circle_points_alone_are_reported_without_pretending(circles_alone):
    verdict = Verdict("NOT_EVALUATED", ("nothing was held out",))
    page = Page(arm_report(circles_alone, to_json(circles_alone, verdict)).html())
    assert "NOT EVALUATED" in page.words
    assert "Nothing was held out." in page.text
    assert "No standard deviations: circle points alone do not give any." in page.words
    assert len([tag for tag, _ in page.tags if tag == "figure"]) == 3
    assert not any(word.startswith("±") for word in page.words)


@pytest.mark.slow
@pytest.mark.usefixtures("undrawn")
def test_the_document_may_come_back_from_its_file(calibration, document, html):
    again = json.loads(json.dumps(document, allow_nan=False))
    assert Page(arm_report(calibration, again).html()).values == Page(html).values
