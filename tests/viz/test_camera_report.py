import numpy as np
import pytest

from nico_selfmodel.estimation.judging import judge, to_json
from nico_selfmodel.viz.reports.cameras import camera_report

from .page import LOADING, Page
from .seen_boards import OUTLIER, UNSEEN


@pytest.fixture(scope="module")
def page(camera_html):
    return Page(camera_html)


@pytest.fixture
def report(monkeypatch):
    """Return a function that writes a report without its figures."""
    monkeypatch.setattr("nico_selfmodel.viz.figures.plot_style.image_bytes", lambda *_: b"<svg/>")

    def write(assessment, images=None, **bounds):
        verdict = judge(assessment, **bounds)
        document = to_json(assessment, verdict)
        return Page(camera_report(assessment, document, images).html())

    return write


def test_the_verdict_comes_first_with_its_reasons(page, cameras):
    ids = [attributes["id"] for _, attributes in page.tags if "id" in attributes]
    assert ids[0] == "verdict"
    start = page.words.index("PASS")
    assert judge(cameras).reasons[0] in page.words[start : start + 6]


def test_every_file_is_named_also_those_without_a_board(page, photographs):
    for camera, of_camera in photographs.items():
        for name in of_camera:
            assert any(f"{camera}{name}.jpg" in word for word in page.words), (camera, name)
    assert "no 5x4 board, <b>whatever</b> was tried" in page.words
    assert page.words.count("no board found") == 3  # in the table, on its card, for its left image


def test_every_photograph_is_shown_with_the_corners_found_in_it(page, photographs):
    images = [attributes for tag, attributes in page.tags if tag == "image"]
    shown = [image for image in images if image["href"].startswith("data:image/jpeg;base64,/9j/")]
    assert len(shown) == sum(len(of_camera) for of_camera in photographs.values())
    crosses = [a["d"] for tag, a in page.tags if tag == "path" and a.get("stroke") == "white"]
    assert len(crosses) == len(shown) - 2
    assert all(path.count("M") == 2 * 20 for path in crosses)


def test_a_cross_lies_on_its_corner(page, cameras):
    paths = [a["d"] for tag, a in page.tags if tag == "path" and a.get("stroke") == "white"]
    name = cameras.calibration.views.names[0]
    u, v = cameras.calibration.views.of_camera("left")[0, 0]
    half = 0.009 * 320
    assert any(path.startswith(f"M{u - half:.1f} {v:.1f}h{2 * half:.1f}") for path in paths), name


def test_the_statistics_and_parameters_are_those_of_the_result(page, camera_result):
    for key in ("test", "cross_validation", "train", "epipolar_px"):
        assert set(camera_result[key]["pixels"].values()) <= set(page.values)
    for name, entry in camera_result["parameters"].items():
        assert name in page.words
        assert repr(float(entry["value"])) in page.words


def test_figures_of_a_pair_are_explained(page, camera_result):
    mean = camera_result["epipolar_px"]["pixels"]["mean"]
    assert f"mean in each image; OpenCV's sample adds both: {2 * mean:.3f} px" in page.words
    tile = page.words[page.words.index("baseline", page.words.index("95 %")) - 1]
    baseline = camera_result["parameters"]["baseline"]
    shown = [float(number) for number in tile.removesuffix(" mm").split(" ± ")]
    wanted = [1e3 * baseline["value"], 1e3 * baseline["sigma"]]
    np.testing.assert_allclose(shown, wanted, rtol=0.06)
    assert "1.59 mm, with squares of 28 mm" in page.text
    assert len([tag for tag, _ in page.tags if tag == "figure"]) == 9


def test_what_the_images_cannot_support_is_said_in_words(page, camera_result):
    assert camera_result["warnings"]
    shown = page.text.replace("\n", " ")
    for warning in camera_result["warnings"]:
        words = warning.replace("+-", "±").split("`")[-1].strip()
        assert words in shown


@pytest.mark.parametrize("part", ["page", "scene"])
def test_nothing_is_loaded_and_names_stay_text(page, part):
    shown = page if part == "page" else Page(page.scene)
    for tag, attributes in shown.tags:
        for name in (LOADING | {"xlink:href"}) & set(attributes):
            assert attributes[name].startswith(("data:", "#")), (tag, name, attributes[name][:80])
    if part == "page":
        assert "my <i>cameras</i>" in page.words
        assert not [tag for tag, _ in page.tags if tag == "script"]


def test_one_camera_is_reported_without_photographs_and_without_a_pair(report, one_camera):
    page = report(one_camera)
    assert "NOT EVALUATED" in page.words
    assert "Nothing was held out." in page.text
    assert not [tag for tag, _ in page.tags if tag in ("image", "svg")]
    assert "epipolar" not in page.text
    assert "left" not in page.words
    for name in one_camera.calibration.views.names:
        assert f"right {name}" in page.words


@pytest.mark.slow
def test_an_outlier_is_named_and_framed_in_red(report, flawed_cameras):
    names = flawed_cameras.calibration.views.names
    grey = np.full((240, 320), 90, dtype=np.uint8)
    page = report(flawed_cameras, {"left": dict.fromkeys((*names, UNSEEN), grey)})
    cards = [a["class"] for tag, a in page.tags if tag == "div" and "card" in a.get("class", "")]
    assert cards.count("card outlier") == 1
    assert f"errors: {OUTLIER} (" in page.text.replace("\n", " ")
    assert len([tag for tag, _ in page.tags if tag == "image"]) == len(names) + 1
    assert [tag for tag, _ in page.tags if tag == "circle"]


@pytest.mark.slow
def test_a_missed_bound_is_red(report, cameras):
    page = report(cameras, require_test_px=0.001)
    assert "FAIL" in page.words
    (body,) = [attributes for tag, attributes in page.tags if tag == "body"]
    assert body["class"] == "FAIL"
