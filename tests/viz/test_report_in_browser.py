"""The report as a person sees it: opened in a browser that can reach nothing else."""

import re
import shutil
import subprocess

import cv2
import numpy as np
import pytest

pytestmark = pytest.mark.browser

FLAGS = [
    "--headless",
    "--no-sandbox",
    "--no-first-run",
    "--disable-quic",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    "--use-gl=angle",
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
    "--hide-scrollbars",
    "--virtual-time-budget=20000",
    "--host-resolver-rules=MAP * ~NOTFOUND",
]
BROWSERS = ("chromium", "chromium-browser", "google-chrome")


@pytest.fixture(scope="module")
def browser():
    found = next((path for path in map(shutil.which, BROWSERS) if path), None)
    if found is None:
        pytest.skip(f"none of {', '.join(BROWSERS)} is installed")
    return found


def screenshot(browser, html, folder, width, height):
    """Return what a page looks like. Shape (height, width, 3), blue, green, red."""
    (folder / "report.html").write_text(html, encoding="utf-8")
    picture = folder / "picture.png"
    subprocess.run(
        [
            browser,
            *FLAGS,
            f"--user-data-dir={folder / 'profile'}",
            f"--window-size={width},{height}",
            f"--screenshot={picture}",
            (folder / "report.html").as_uri(),
        ],
        check=True,
        capture_output=True,
        timeout=120,
    )
    return cv2.imread(str(picture))


@pytest.mark.slow
def test_the_report_shows_its_verdict_and_the_scene(browser, tmp_path, html):
    picture = screenshot(browser, html, tmp_path, 1400, 1250)
    assert picture.shape == (1250, 1400, 3)
    # The bar of the verdict is green, #146c3a.
    assert np.any(np.all(np.abs(picture[:300].astype(int) - [0x3A, 0x6C, 0x14]) < 12, axis=2))
    # The scene: the colours of at least three joints are there, beside shades of the background.
    scene = picture[560:1180, 150:980]
    assert len(np.unique(scene.reshape(-1, 3), axis=0)) > 2000
    hue, saturation, _ = cv2.split(cv2.cvtColor(scene, cv2.COLOR_BGR2HSV))
    strong = hue[saturation > 120]
    for low, high in ((95, 120), (5, 20), (50, 80)):  # blue, orange, green
        assert np.sum((strong >= low) & (strong <= high)) > 300, (low, high)


@pytest.mark.slow
def test_a_failure_is_red_at_a_glance_also_in_a_narrow_window(browser, tmp_path, failed_html):
    picture = screenshot(browser, failed_html, tmp_path, 520, 700).astype(int)
    red = (picture[..., 2] > 150) & (picture[..., :2].max(axis=2) < 60)
    assert red.sum() > 1500
    # Nothing is wider than the window: the verdict's tint ends before the right margin.
    assert np.all(picture[150:500, -8:] == 255)


@pytest.mark.slow
def test_the_cameras_their_boards_and_the_epipolar_plane_are_seen(browser, tmp_path, camera_html):
    picture = screenshot(browser, camera_html, tmp_path, 1400, 1500)
    hue, saturation, value = cv2.split(cv2.cvtColor(picture[600:], cv2.COLOR_BGR2HSV))
    strong = hue[(saturation > 110) & (value > 60)]
    # Teal and purple cameras, blue boards, the yellow epipolar lines.
    for low, high in ((80, 90), (155, 170), (100, 118), (20, 28)):
        assert np.sum((strong >= low) & (strong <= high)) > 200, (low, high)


MEASURE = """<iframe id="page" src="report.html" width="%d" height="900"></iframe><script>
document.getElementById("page").onload = event => {
  const page = event.target.contentDocument, root = page.documentElement;
  page.querySelectorAll("details").forEach(one => one.open = true);
  const wide = [...page.body.querySelectorAll("*")].filter(one => !one.closest("svg"))
    .filter(one => one.scrollWidth > one.clientWidth + 1 && one.clientWidth > 0
      || one.getBoundingClientRect().right > root.clientWidth + 1);
  const small = [...page.querySelectorAll(".panels text")]
    .map(one => one.getBoundingClientRect().height).filter(height => height && height < 7.5);
  const told = wide.map(one => `${one.tagName} ${one.textContent.trim().slice(0, 40)}`);
  const broken = [], walk = page.createTreeWalker(page.body, NodeFilter.SHOW_TEXT);
  for (let node; node = walk.nextNode();) {
    if (!node.parentElement.closest("table")) continue;
    for (const found of node.data.matchAll(/(?<!\\S)[−+-]?\\d+(\\.\\d*)?(e[+-]?\\d+)?(?!\\S)/g)) {
      const range = page.createRange();
      range.setStart(node, found.index);
      range.setEnd(node, found.index + found[0].length);
      const lines = new Set([...range.getClientRects()].map(one => Math.round(one.top)));
      if (lines.size > 1) broken.push(found[0]);
    }
  }
  document.title = [root.scrollWidth, told, small.length, broken]
    .join("|");
};</script>"""


@pytest.mark.slow
@pytest.mark.parametrize("width", [380, 400, 560, 700, 1280])
@pytest.mark.parametrize("report", ["html", "camera_html", "failed_html"])
def test_no_width_scrolls_sideways_or_breaks_a_number(browser, tmp_path, request, report, width):
    (tmp_path / "report.html").write_text(request.getfixturevalue(report), encoding="utf-8")
    (tmp_path / "measure.html").write_text(MEASURE % width, encoding="utf-8")
    words = [
        *(browser, *FLAGS, "--allow-file-access-from-files", "--dump-dom"),
        *(f"--user-data-dir={tmp_path / 'profile'}", (tmp_path / "measure.html").as_uri()),
    ]
    done = subprocess.run(words, check=True, capture_output=True, text=True, timeout=120)
    title = re.search(r"<title>(.*?)</title>", done.stdout, re.DOTALL)[1]
    needed, wide, small, broken = title.split("|")
    assert int(needed) <= width
    assert (wide, broken) == ("", "")
    assert int(small) == 0
