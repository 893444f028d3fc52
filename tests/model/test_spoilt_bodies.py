"""What no body has is refused where its file is read, and not believed."""

import numpy as np
import pytest
import yaml

from nico_selfmodel.errors import ModelError
from nico_selfmodel.model.self_model import ParameterCovariance
from nico_selfmodel.model.tree.body_model import BodyModel, load_body, save_body

from ..estimation.simulated_trees import one_arm

KNOWN = ParameterCovariance(("j1.gear", "hand_tag0.x"), 1e-8 * np.eye(2))


@pytest.fixture(scope="module")
def text(tmp_path_factory):
    tree = one_arm(0, joints=3, markers=2, poses=2).tree
    expected = {"mm": {"median": 0.3, "n": 40.0}}
    limits = np.array([[-1.0] * 3, [1.0] * 3])
    body = BodyModel("arm", tree, np.ones(3), KNOWN, {"tracker": 2e-4}, expected, limits=limits)
    path = tmp_path_factory.mktemp("body") / "body.yaml"
    save_body(body, path)
    return path.read_text(encoding="utf-8")


def scaled(content):
    content["joints"][1]["X_PJ"] = (2.0 * np.eye(4)).tolist()


def mirrored(content):
    content["markers"][0]["X_LA"] = np.diag([1.0, 1.0, -1.0, 1.0]).tolist()


def flat(content):
    content["markers"][0]["X_LA"] = np.eye(3).tolist()


def no_gear(content):
    content["joints"][0]["gear"] = 0.0


def no_unit(content):
    content["joints"][2]["si_per_unit"] = 0


def crossed(content):
    content["joints"][0]["lower"] = 2.0


def quiet(content):
    content["noise"]["tracker"] = -1.0


def wordy(content):
    content["expected"]["mm"]["median"] = "small"


def lucky(content):
    del content["expected"]["mm"]["median"]


def elsewhere(content):
    content["markers"][1]["on"] = "j9"


def orphan(content):
    content["joints"][2]["parent"] = "j9"


def strange(content):
    content["covariance"]["names"][0] = "j9.gear"


@pytest.mark.parametrize(
    ("spoil", "words"),
    [
        (scaled, "X_PJ of j2 is not a rigid transform"),
        (mirrored, "X_LA of hand_tag0 is not a rigid transform"),
        (flat, r"X_LA of hand_tag0 must have shape \(4, 4\)"),
        (no_gear, "gear of joint 'j1' must not be 0"),
        (no_unit, "si_per_unit of joint 'j3' must not be 0"),
        (crossed, "lower of joint 'j1' is above upper: 2 and 1"),
        (quiet, "noise of tracker must not be negative"),
        (wordy, "median of expected mm must be numbers, got 'small'"),
        (lucky, "expected mm must have a median"),
        (elsewhere, "hand_tag1 is on 'j9', which is no link; there are j1, j2, j3"),
        (orphan, "joint j3 is on 'j9', which is no link"),
        (strange, "covariance names 'j9.gear', of which the body has nothing"),
    ],
)
def test_what_no_body_has_is_refused_by_name(text, tmp_path, spoil, words):
    path = tmp_path / "body.yaml"
    path.write_text(text, encoding="utf-8")
    assert load_body(path).name == "arm"
    content = yaml.safe_load(text.replace("\n  on:", "\n  'on':"))
    spoil(content)
    path.write_text(yaml.safe_dump(content), encoding="utf-8")
    with pytest.raises(ModelError, match=words):
        load_body(path)
