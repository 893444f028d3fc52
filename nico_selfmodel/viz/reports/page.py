"""The one page of every report: the verdict first, then sections, nothing loaded."""

import base64
import gzip
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from jinja2 import Environment, PackageLoader, StrictUndefined

from nico_selfmodel.viz.figures import palette
from nico_selfmodel.viz.figures.rgba import Rgba
from nico_selfmodel.viz.live.static_page import static_html
from nico_selfmodel.viz.reports import parts
from nico_selfmodel.viz.reports.compiled_templates import CompiledTemplates
from nico_selfmodel.viz.reports.residual_rows import RESIDUALS_FILE
from nico_selfmodel.viz.reports.tables import UNIT_OF
from nico_selfmodel.viz.scene.scene import SCENE_FILE, Scene
from nico_selfmodel.viz.scene.surroundings import NIGHT_SCRIPT

REPORT_FILE = "report.html"
_PARTS = (
    *(parts.Section, parts.Text, parts.Bullets, parts.Numbers, parts.Drawing, parts.Tiles),
    *(parts.Stage, parts.Beside, parts.Folded, parts.Gallery),
)
"""What `parts.html.j2` has a template for."""
_MEANING = {
    "PASS": "Held-out data were evaluated and no check failed.",
    "FAIL": "Do not rely on this model before the points below are settled.",
    "NOT_EVALUATED": "No check failed, but the data leave open whether it is right.",
}

_DARK_SCENE = (
    NIGHT_SCRIPT
    + """
fetch("data:,").then(found => found.arrayBuffer()).then(() => setTimeout(paint));
"""
)
"""After what Drake's page draws, in the same queue, the background is the night's."""
_UNPACK = """
const bytes = Uint8Array.from(atob("PACKED"), letter => letter.charCodeAt(0));
const unpacked = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("gzip"));
new Response(unpacked).text().then(page => {
  document.open();
  document.write(page);
  document.close();
});
"""
"""The scene's page is megabytes, most of them its viewer: packed it is a quarter of that."""


@dataclass(frozen=True)
class Key:
    """The number that matters most."""

    number: str
    """With its unit."""
    what: str
    """What it is, and of which data."""
    note: str
    """What to know beside it."""


@dataclass(frozen=True, eq=False)
class Report:
    """A report on one calibration."""

    name: str
    """What it is about."""
    about: str
    """What was done, in a line."""
    document: Mapping[str, Any]
    """Content of `result.json`: its status, reasons and warnings stand first."""
    key: Key
    """Beside the verdict."""
    sections: tuple[parts.Section, ...]
    """Below the first page, in this order."""
    scene: Scene | parts.Drawing
    """The picture of the first page; a scene is kept beside it, for `view`."""
    learned: tuple[Any, ...] = ()
    """What was learned, beside the picture: tables and what is to be known of them."""
    residuals: str = ""
    """CSV of what was measured and predicted, to download."""

    def files(self) -> dict[str, str]:
        """Return the files that show a result: report, residuals, and the scene for `view`.

        Raises:
            SelfModelError: If Drake's page for scenes is not one that is known.
        """
        files = {REPORT_FILE: self.html()}
        if isinstance(self.scene, Scene):
            files[SCENE_FILE] = self.scene.to_json()
        return files | ({RESIDUALS_FILE: self.residuals} if self.residuals else {})

    @property
    def picture(self) -> parts.Stage | parts.Drawing:
        """The picture of the first page as a part of it."""
        return parts.Stage(self.scene) if isinstance(self.scene, Scene) else self.scene

    def html(self) -> str:
        """Return the report as one self-contained page, which loads nothing from anywhere.

        Raises:
            SelfModelError: If Drake's page for scenes is not one that is known.
        """
        status = self.document["status"]
        return (
            page_environment()
            .get_template("report.html.j2")
            .render(
                report=self,
                status=status,
                meaning=_MEANING[status],
                warnings=tuple(self.document.get("warnings", ())),
                run=self.document.get("run"),
            )
        )


def page_environment() -> Environment:
    """Return what templates of pages are filled in by."""
    environment = Environment(
        loader=PackageLoader("nico_selfmodel.viz.reports"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        bytecode_cache=CompiledTemplates(),
    )
    environment.filters |= {
        "css": _css_color,
        "kind": _kind,
        "base64": _base64,
        "viewer": _viewer,
    }
    return environment


def key_number(
    document: Mapping[str, Any],
    quantity: str,
    things: str,
    *,
    statistics: tuple[str, str] = ("mean", "rms"),
    digits: int = 2,
    note: str = "",
) -> Key:
    """Return the error that matters most: held out, else cross-validated, else of training.

    Args:
        document: Content of `result.json`.
        quantity: `position_mm`, `pixels` or `angle_deg`.
        things: What the errors are of.
        statistics: What is shown large, and what small.
        note: What else to show small.

    Raises:
        ValueError: If there are no errors.
    """
    name, label = telling_set(document, things)
    block, unit = document[name], UNIT_OF[quantity]
    large, small = (f"{block[quantity][one]:.{digits}f} {unit}" for one in statistics)
    shown = {"sd": "SD"}.get(statistics[1], statistics[1])
    beside = [f"{shown} {small}", f"{block['n']} {things}", note]
    return Key(large, f"{statistics[0]} error {label}", " · ".join(filter(None, beside)))


def headline_quantity(document: Mapping[str, Any], things: str) -> str:
    """Return the unit in which a body's errors are told first: millimetres where there are any.

    Args:
        document: Content of `result.json`.
        things: What the errors are of.

    Returns:
        `position_mm` or `pixels`.
    """
    name, _ = telling_set(document, things)
    return "position_mm" if document[name].get("position_mm") else "pixels"


def telling_set(document: Mapping[str, Any], things: str) -> tuple[str, str]:
    """Return the most telling set of errors that there is, and what it is called.

    Args:
        document: Content of `result.json`.
        things: What the errors are of.

    Raises:
        ValueError: If there are none.
    """
    for name, label in (
        ("test", f"on held-out {things}"),
        ("cross_validation", "in cross-validation"),
        ("train", f"on the training {things}"),
    ):
        if document[name] is not None:
            return name, label
    raise ValueError("the document holds no statistics of errors")


def _kind(part: Any) -> str:
    """Return the name under which `parts.html.j2` knows a part."""
    if type(part) not in _PARTS:
        raise TypeError(
            f"a report has no template for a {type(part).__name__}: add one to parts.html.j2"
        )
    return type(part).__name__


def _base64(text: str) -> str:
    return base64.b64encode(text.encode()).decode()


def _viewer(scene: Scene) -> str:
    """Return the interactive scene as a page of its own, dark where the reader's pages are."""
    page = static_html(scene).replace("</body>", f"<script>{_DARK_SCENE}</script></body>")
    packed = base64.b64encode(gzip.compress(page.encode(), 5, mtime=0)).decode()
    return f"<!doctype html><script>{_UNPACK.replace('PACKED', packed)}</script>"


def _css_color(color: Rgba) -> str:
    if color == palette.rgba(palette.INK):
        return "var(--ink)"  # chalk on dark pages, as in the scene
    red, green, blue = (round(255 * c) for c in color[:3])
    return f"rgb({red} {green} {blue} / {color[3]:.2f})"
