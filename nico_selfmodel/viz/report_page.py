"""What the pages of all reports share: one frame, the verdict first, nothing loaded."""

from collections.abc import Mapping
from typing import Any

from jinja2 import Environment, PackageLoader, StrictUndefined

from nico_selfmodel.estimation import Verdict
from nico_selfmodel.viz.drake_backend import static_html
from nico_selfmodel.viz.numbers_shown import signed
from nico_selfmodel.viz.scene import Scene
from nico_selfmodel.viz.scene_items import Rgba

_MEANING = {
    "PASS": "Held-out data were evaluated and no check failed.",
    "FAIL": "Do not rely on this model before the points below are settled.",
    "NOT_EVALUATED": "No check failed, but nothing was held out to test the model on.",
}


def page(template: str, name: str, verdict: Verdict, scene: Scene, **content: Any) -> str:
    """Return a report as one self-contained page.

    Args:
        template: File in `templates`.
        name: What the report is about.
        verdict: What is thought of it.
        scene: What to show.
        content: What else the template asks for.

    Returns:
        HTML that loads nothing from anywhere.

    Raises:
        SelfModelError: If the server that makes the interactive scene cannot start.
    """
    environment = Environment(
        loader=PackageLoader("nico_selfmodel.viz"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters["css"] = _css_color
    environment.filters["signed"] = signed
    return environment.get_template(template).render(
        name=name,
        status=verdict.status,
        status_text=verdict.status.replace("_", " "),
        meaning=_MEANING[verdict.status],
        reasons=verdict.reasons,
        scene=scene,
        scene_html=static_html(scene),
        **content,
    )


def key_statistics(document: Mapping[str, Any], quantity: str, things: str) -> dict[str, Any]:
    """Return the statistics that matter most, with what they are of.

    Args:
        document: Content of `result.json`.
        quantity: `position_mm` or `pixels`.
        things: What the errors are of.

    Raises:
        ValueError: If there are none.
    """
    for key, label in (
        ("test", f"on held-out {things}"),
        ("cross_validation", "in cross-validation"),
        ("train", f"on the training {things}"),
    ):
        if document[key] is not None:
            return {"set": key, "label": label, "n": document[key]["n"], **document[key][quantity]}
    raise ValueError("the document holds no statistics of errors")


def _css_color(color: Rgba) -> str:
    red, green, blue = (round(255 * c) for c in color[:3])
    return f"rgb({red} {green} {blue} / {color[3]:.2f})"
