"""The page that every report is rendered by, and the one table of parameters."""

from dataclasses import dataclass
from unittest import mock

import pytest

from nico_selfmodel.viz.figures.layout.plain_figure import PlainFigure
from nico_selfmodel.viz.reports import parts
from nico_selfmodel.viz.reports.camera_gallery import Gallery, GalleryRow
from nico_selfmodel.viz.reports.page import Key, Report, key_number
from nico_selfmodel.viz.reports.parameter_tables import ParameterTables
from nico_selfmodel.viz.reports.tables import Cell, Table, change_table, error_table, held_out
from nico_selfmodel.viz.scene.scene import Camera, Scene

from .page import Page

SCENE = Scene("nothing", (), Camera([1.0, 0.0, 0.0], [0.0, 0.0, 0.0]))
ERRORS = dict.fromkeys(("mean", "sd", "rms", "median", "p95", "max"), 1.0)


def rendered(*shown, document=None):
    document = {"status": "PASS", "reasons": ["all `is` well"]} | (document or {})
    section = parts.section("A question", *shown, message="What to know.", id="question")
    with mock.patch("nico_selfmodel.viz.reports.page.static_html", return_value="the scene"):
        key = Key("1 mm", "error", "of one")
        return Page(Report("it", "about it", document, key, (section,), SCENE).html())


def table(rows):
    return Table(("", "number"), tuple((str(k), (Cell(f"cell {k}"),)) for k in range(rows)))


@pytest.mark.parametrize(
    ("part", "word"),
    [
        (parts.Text("a sentence"), "a sentence"),
        (parts.Bullets(("a line",)), "a line"),
        (parts.Numbers(table(2)), "cell 1"),
        (parts.Tiles((parts.Tile("7 mm", "long", "about"),)), "7 mm"),
        (parts.Beside((parts.Text("left of"),)), "left of"),
        (parts.Folded("more", (parts.Text("folded away"),)), "folded away"),
        (parts.section("Within", parts.Text("deeper")), "deeper"),
        (Gallery((GalleryRow("view 3", "training", ()),)), "view 3"),
        (parts.Stage(SCENE), "Drag to turn"),
    ],
)
def test_every_part_stands_in_its_section(part, word):
    page = rendered(part)
    assert word in page.text[page.text.index("What to know.") :]


def test_a_figure_is_an_image_that_says_what_it_shows():
    figure = PlainFigure()
    figure.suptitle("It rises")
    figure.subplots().set_xlabel("time [s]")
    page = rendered(parts.Drawing(figure, "a curve"))
    (image,) = [a for tag, a in page.tags if tag == "figure"]
    assert (image["role"], image["aria-label"]) == ("img", "a curve")
    assert page.words.count("It rises") == 1
    assert "time [s]" in page.words


def test_a_part_that_the_page_does_not_know_is_an_error_and_not_left_out():
    @dataclass
    class Song:
        words: str

    with pytest.raises(TypeError, match="no template for a Song"):
        rendered(Song("la"))


def test_parts_that_there_are_not_leave_no_trace():
    found = parts.section("A question", parts.numbers(None), parts.drawing("nothing", None))
    assert found.parts == ()
    assert parts.numbers(table(0)) is None
    assert parts.halves(("nothing", None)).parts == ()


def test_long_tables_are_folded_where_their_rows_have_a_name():
    def folds(part):
        return [tag for tag, _ in rendered(part).tags].count("details")

    assert folds(parts.Numbers(table(13), rows="starts")) == 1
    assert folds(parts.Numbers(table(12), rows="starts")) == 0
    assert folds(parts.Numbers(table(13))) == 0


def test_the_strongest_doubt_stands_before_the_sections_and_others_are_folded():
    def ids(document):
        return [a["id"] for _, a in rendered(document=document).tags if "id" in a]

    assert ids({"warnings": ["it is ± dark"]}) == ["verdict", "scene", "warnings", "question"]
    assert ids({"warnings": []}) == ids({})


def test_the_first_page_says_which_doubt_is_the_strongest_or_that_there_is_none():
    doubts = rendered(document={"warnings": ["it is ± dark", "it rains", "it is late"]})
    start = doubts.words.index("Strongest doubt")
    assert doubts.words[start + 1 : start + 5] == [
        "it is ± dark",
        "2 more",
        "it rains",
        "it is late",
    ]
    assert "No check found one." in rendered().words
    few = rendered(document={"status": "NOT_EVALUATED"})
    assert any("Too little was held out" in word for word in few.words)


def test_a_page_tells_when_and_by_which_command_it_was_made():
    run = {"date": "2026-01-02T03:04:05+00:00", "command": "nico-selfmodel x <y>", "version": "9"}
    page = rendered(document={"run": run})
    assert "nico-selfmodel x <y>" in page.words
    assert any("2026-01-02 at 03:04 UTC" in word for word in page.words)
    assert "Made on" not in rendered().text


def test_a_section_within_a_section_has_a_smaller_heading():
    tags = [tag for tag, _ in rendered(parts.section("Within")).tags]
    assert (tags.count("h2"), tags.count("h3")) == (2, 1)


def entry(value, sigma, free, unit="m"):
    return {"value": value, "sigma": sigma, "unit": unit, "free": free}


def test_a_parameter_is_free_fixed_derived_unobservable_or_unknown():
    entries = {
        "a": entry(0.1, 0.002, True),
        "b": entry(0.25, 0.0, False),
        "c": entry(0.07, 0.001, False),
        "d": entry(0.1, 0.5, True),
        "e": entry(0.1, None, True),
        "f": entry(None, None, False),
        "g": entry(0.2, None, False),
    }
    found = ParameterTables(entries, frozenset("d"))
    kinds = ["free", "fixed", "derived", "unobservable", "unknown", "unknown", "derived"]
    assert [found.kind(name) for name in entries] == kinds
    assert found.cell("a") == Cell("100.0", "± 2.0", "free", 0.1)
    assert found.cell("b") == Cell("250", "fixed", "fixed", 0.25)
    assert found.cell("d").note == "unobservable ± 500"
    assert found.cell("f").text == "not known"
    assert found.cell("none such").text == ""
    rows = dict(found.everything().rows)
    assert [cell.text for cell in rows["b"]] == ["0.25", "", "m", "fixed"]
    assert [cell.text for cell in rows["a"]] == ["0.1", "0.002", "m", "free"]


def test_the_most_telling_errors_come_first_and_are_the_key_number():
    train = {"n": 9, "position_mm": ERRORS, "pixels": ERRORS}
    test = {"n": 4, "pixels": {**ERRORS, "mean": 2.0}}
    document = {"test": test, "cross_validation": None, "train": train}
    found = error_table(held_out(document, "pixels"), "in the images", 2)
    assert [name for name, _ in found.rows] == ["held-out", "training"]
    assert found.rows[0][1][0].value == 4
    assert [name for name, _ in error_table(held_out(document, "position_mm"), "", 2).rows] == [
        "training"
    ]
    key = key_number(document, "pixels", "points", note="as told")
    assert key == Key(
        "2.00 px", "mean error on held-out points", "rms 1.00 px · 4 points · as told"
    )
    with pytest.raises(ValueError, match="no statistics"):
        key_number(dict.fromkeys(document), "pixels", "points")


def test_a_change_without_a_sigma_has_as_many_digits_as_it_is_large():
    change = {"before": 1.0, "after": 1.0123, "change": 0.0123, "sigma": None, "unit": "m"}
    ((_, cells),) = change_table({"length": change}).rows
    assert [cell.text for cell in cells] == ["1000.0", "1012.3", "+12.3", "", "", "mm"]
