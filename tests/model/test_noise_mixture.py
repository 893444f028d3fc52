"""Core and tail of the noise, as numbers and on disk."""

from dataclasses import replace

import pytest

from nico_selfmodel.errors import ModelError
from nico_selfmodel.model.noise_mixture import NoiseMixture, mixtures_of
from nico_selfmodel.model.self_model import SelfModel
from nico_selfmodel.model.self_model_file import load_model, save_model

NOISE = NoiseMixture(6e-4, 0.006, 1.2e-3, 0.02, 0.1, 0.005, 100)
ENTRY = NOISE.as_document("points")


def test_what_is_written_is_read_back_to_the_last_bit():
    fit = {"noise": {"points": ENTRY, "pixels": NOISE.as_document("pixels")}}
    assert mixtures_of(fit) == {"points": NOISE, "pixels": NOISE}
    assert mixtures_of({}) == {}


def test_a_self_model_carries_its_noise_through_its_file(tmp_path):
    model = SelfModel("cameras", fit={"noise": {"pixels": NOISE.as_document("pixels")}})
    save_model(model, tmp_path / "self_model.yaml")
    assert load_model(tmp_path).noise_mixtures == {"pixels": NOISE}


@pytest.mark.parametrize(
    ("key", "value", "message"),
    [
        ("sensor_sigma_m", float("nan"), "between 0 and 10"),
        ("sensor_sigma_m", float("inf"), "between 0 and 10"),
        ("sensor_sigma_m", 5e3, "between 0 and 10"),
        ("sensor_sigma_m", 0.0, "must be positive"),
        ("sensor_sigma_m", "wide", "between 0 and 10, got 'wide'"),
        ("joint_sigma_rad", -0.1, "between 0 and 3.14"),
        ("tail_joint_sigma_rad", 7.0, "between 0 and 3.14"),
        ("tail_joint_sigma_rad", 0.001, "not be narrower"),
        ("tail_sensor_sigma_m", 1e-4, "not be narrower"),
        ("tail_share", 0.7, "between 0 and 0.5"),
        ("outlier_share", True, "between 0 and 0.5"),
        ("poses", 0, "positive whole number"),
        ("poses", 3.5, "positive whole number"),
    ],
)
def test_what_is_no_noise_is_refused_on_loading(tmp_path, key, value, message):
    path = tmp_path / "self_model.yaml"
    save_model(SelfModel("cameras", fit={"noise": {"points": ENTRY}}), path)
    text = path.read_text()
    assert f"{key}: {ENTRY[key]}" in text
    path.write_text(text.replace(f"  {key}: {ENTRY[key]}", f"  {key}: {_yaml(value)}"))
    with pytest.raises(ModelError, match=message):
        load_model(path)


@pytest.mark.parametrize(
    ("noise", "message"),
    [
        ({"sonar": ENTRY}, "points, pixels, got sonar"),
        ({"points": 0.1}, "fit.noise.points must be a mapping"),
        ([1.0], "fit.noise must be a mapping"),
        ({"pixels": ENTRY}, "fit.noise.pixels lacks sensor_sigma_px, tail_sensor_sigma_px"),
    ],
)
def test_other_noise_is_refused_by_name(noise, message):
    with pytest.raises(ValueError, match=message):
        SelfModel("cameras", fit={"noise": noise})


def test_a_tail_is_wider_and_rarer_than_its_core():
    with pytest.raises(ValueError, match="narrower"):
        replace(NOISE, tail_sensor_sigma=1e-4)
    with pytest.raises(ValueError, match="tail_share must be between"):
        replace(NOISE, tail_share=0.6)


def _yaml(value):
    return {"nan": ".nan", "inf": ".inf", "True": "true"}.get(str(value), value)


def test_core_and_tail_have_one_variance_together():
    assert NOISE.rms_joint_sigma == pytest.approx((0.9 * 0.006**2 + 0.1 * 0.02**2) ** 0.5)
