"""The page of a scene that Drake's viewer shows without Drake: drawn as Drake itself draws it."""

import base64
import json
import re
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest
from meshcat.visualizer import umsgpack

from nico_selfmodel.errors import SelfModelError
from nico_selfmodel.viz.live import static_page
from nico_selfmodel.viz.live.drake_backend import draw_in_drake
from nico_selfmodel.viz.live.static_page import static_html
from nico_selfmodel.viz.scene.arm_scene import calibration_scene
from nico_selfmodel.viz.scene.scene import ROOT, Camera, Scene

from .every_item import every_item

LEFT_OUT = {"uuid", "geometry", "material", "linewidth", "wireframeLineWidth", "reflectivity"}
"""Names, and what says what three.js takes anyway."""


@pytest.fixture(scope="module")
def everything():
    camera = Camera(np.array([2.0, -1.0, 1.0]), np.array([0.1, 0.2, 0.3]))
    return Scene("everything", every_item(), camera)


def commands_of(page):
    """Return the commands of our page, by path and what they set."""
    return keyed(json.loads(one) for one in re.findall(r"^draw\((\{.*\})\);$", page, re.MULTILINE))


def commands_of_drake(page):
    """Return the commands of Drake's page."""
    packed = re.findall(r'fetch\("data:application/octet-binary;base64,([A-Za-z0-9+/=]+)"', page)
    return keyed(umsgpack.unpackb(base64.b64decode(one)) for one in packed)


def keyed(commands):
    return {
        (one["type"], one.get("path", "").replace("/<object>", ""), one.get("property")): one
        for one in commands
    }


def numbers(attribute):
    """Return what an array of either page holds."""
    told = attribute["array"]
    content = base64.b64decode(told) if isinstance(told, str) else told.data
    kinds = {"Float32Array": "<f4", "Uint32Array": "<u4", "Uint16Array": "<u2"}
    return np.frombuffer(content, kinds[attribute["type"]]).astype(float)


def assert_alike(ours, drakes):
    """Compare what both say, but for names and for what three.js takes anyway."""
    if isinstance(drakes, dict) and "array" in drakes:
        assert numbers(ours) == pytest.approx(numbers(drakes), abs=2.0**-15)
    elif isinstance(drakes, dict):
        for key in (drakes.keys() | ours.keys()) - LEFT_OUT:
            if key == "color" and isinstance(drakes[key], int):
                parts = [list(color.to_bytes(3)) for color in (ours[key], drakes[key])]
                assert np.abs(np.subtract(*parts)).max() <= 1
            elif key == "data" and isinstance(drakes[key], str):
                meshes = [json.loads(text)["accessors"] for text in (ours[key], drakes[key])]
                assert_alike(*meshes)
            elif ours.get(key) or drakes.get(key):
                assert_alike(ours.get(key), drakes.get(key))
    elif isinstance(drakes, list):
        assert len(ours) == len(drakes)
        for one, other in zip(ours, drakes, strict=True):
            assert_alike(one, other)
    else:
        assert ours == (pytest.approx(drakes) if isinstance(drakes, float) else drakes)


def test_every_item_is_drawn_as_drake_draws_it(everything):
    ours = commands_of(static_html(everything))
    drakes = commands_of_drake(draw_in_drake(everything).StaticHtml())
    # What turns the camera's rig is how it stands anyway.
    assert drakes.keys() - ours.keys() == {("set_transform", "/Cameras/default", None)}
    for key, command in ours.items():
        assert_alike(command.get("value"), drakes[key].get("value"))
        assert_alike(command.get("matrix"), drakes[key].get("matrix"))
        assert_alike(command.get("object"), drakes[key].get("object"))
    assert sum(kind == "set_object" for kind, _, _ in ours) == len(everything.items) + 1


def test_the_page_holds_the_whole_scene_of_a_calibration(calibration):
    scene = calibration_scene(calibration)
    drawn = {path for kind, path, _ in commands_of(static_html(scene)) if kind == "set_object"}
    assert drawn >= {f"{ROOT}/{path}" for path in scene.paths}


def test_the_page_is_without_decoders_that_nothing_in_it_needs(everything):
    page = static_html(everything)
    assert not re.search("(wasm|javascript);base64,", page)
    assert len(page) < 1.5e6
    assert page == static_html(everything)


def test_no_name_ends_the_script(everything):
    odd = replace(everything.items[0], path="</script><b>")
    page = static_html(replace(everything, items=(odd,)))
    assert ("set_object", f"{ROOT}/</script><b>", None) in commands_of(page)
    assert "</script><b>" not in page


def test_a_page_of_drake_that_is_not_known_is_an_error(everything, monkeypatch):
    monkeypatch.setattr(static_page, "_of_drake", lambda name: "<html></html>")
    with pytest.raises(SelfModelError, match=r"meshcat\.html has no place for commands"):
        static_html(everything)


def test_drake_itself_is_not_loaded():
    code = "import sys, nico_selfmodel.viz.reports.page; assert 'pydrake' not in sys.modules"
    subprocess.run([sys.executable, "-c", code], check=True)
