"""Responses of joints to steps: formulas, and their file."""

from dataclasses import replace

import numpy as np
import pytest

from nico_selfmodel.errors import DataError, ModelError
from nico_selfmodel.model.response.servo_response import (
    ServoResponse,
    ServoResponses,
    load_responses,
    save_responses,
)
from nico_selfmodel.model.response.step_response import LOOP, PROFILE, step_response
from nico_selfmodel.model.self_model import ParameterCovariance

from ..simulated_steps import SERVOS

PARTS = {"speed": 1.2, "acceleration": 6.0, "rate": 15.0}
SHAPES = [
    (PROFILE, ("speed",)),
    (PROFILE, ("acceleration",)),
    (PROFILE, ("speed", "acceleration")),
    (PROFILE, ("speed", "acceleration", "rate")),
    (LOOP, ("rate",)),
    (LOOP, ("speed", "rate")),
]


@pytest.mark.parametrize(("kind", "names"), SHAPES)
def test_a_joint_begins_at_rest_ends_where_it_should_and_the_derivatives_say_how(kind, names):
    parts = {name: PARTS[name] for name in names}
    rng = np.random.default_rng(0)
    way, time = rng.uniform(0.05, 1.0, 300), rng.uniform(-0.1, 1.2, 300)
    gone, slopes = step_response(kind, way, time, parts)
    assert (gone >= -1e-12).all()
    assert (gone <= way + 1e-9).all()
    assert gone[time <= 0.0] == pytest.approx(0.0, abs=1e-12)
    assert step_response(kind, way, 9.0 + time, parts)[0] == pytest.approx(way, abs=1e-6)
    h = 1e-6
    for name in ("time", *names):
        up, down = (
            step_response(kind, way, time + sign * h * (name == "time"), {
                key: value * np.exp(sign * h * (key == name)) for key, value in parts.items()
            })[0]
            for sign in (1, -1)
        )  # fmt: skip
        assert slopes[name] == pytest.approx((up - down) / (2.0 * h), abs=2e-4), name


def test_a_profile_is_the_trapezoid_that_a_controller_plans_followed_with_a_lag():
    time, dt = np.linspace(0.0, 2.0, 20_001, retstep=True)
    place, speed, lagging, seen = 0.0, 0.0, 0.0, []
    for _ in time:
        seen.append(lagging)
        brakes = 0.6 - place <= 0.5 * speed**2 / 3.0
        speed = max(0.0, speed - 3.0 * dt) if brakes else min(0.8, speed + 3.0 * dt)
        place += speed * dt
        lagging += 10.0 * (place - lagging) * dt
    found = ServoResponse("a", PROFILE, 0.0, 0.0, 0.8, 3.0, 10.0).after(0.6, time)
    assert found == pytest.approx(seen, abs=1e-3)


def test_a_way_down_is_a_way_up_turned_round_and_comes_later_by_the_delay():
    response = SERVOS[1]
    time = np.linspace(0.0, 1.0, 50)
    assert response.after(-0.3, time) == pytest.approx(-response.after(0.3, time))
    prompt = replace(response, delay=0.0)
    assert response.after(0.3, time + response.delay) == pytest.approx(prompt.after(0.3, time))


@pytest.mark.parametrize(
    ("numbers", "words"),
    [
        (("spline", 0.1, 0.0, 1.0), "spline"),
        ((PROFILE, 0.1, 0.0), "not the numbers of a profile"),
        ((LOOP, 0.1, 0.0, 1.0), "not the numbers of a loop"),
        ((LOOP, 0.1, 0.0, 1.0, 2.0, 3.0), "not the numbers of a loop"),
        ((PROFILE, 0.1, 0.0, -1.0), "must be positive"),
        ((PROFILE, np.nan, 0.0, 1.0), "delay must be finite"),
    ],
)
def test_a_response_that_cannot_be_is_refused(numbers, words):
    with pytest.raises(ValueError, match=words):
        ServoResponse("a", *numbers)


def test_responses_survive_the_round_trip(tmp_path):
    names = ("shoulder.delay", "wrist.rate")
    known = ParameterCovariance(names, np.diag([1e-6, 0.04]))
    model = ServoResponses("arm", SERVOS, known, {"dataset": "steps"})
    save_responses(model, tmp_path / "servo_response.yaml")
    found = load_responses(tmp_path)
    assert found.joints == model.joints
    assert found.covariance.names == names
    assert np.array_equal(found.covariance.matrix, known.matrix)
    assert found.of("wrist").rate == 8.0
    with pytest.raises(ValueError, match="knee"):
        found.of("knee")


def test_another_file_and_a_damaged_one_are_named(tmp_path):
    with pytest.raises(DataError, match=r"servo_response\.yaml"):
        load_responses(tmp_path)
    path = tmp_path / "servo_response.yaml"
    path.write_text("format: nico-body/1\n")
    with pytest.raises(ModelError, match="nico-servo-response/1"):
        load_responses(path)
    save_responses(ServoResponses("arm", SERVOS), path)
    text = path.read_text()
    path.write_text(text[: text.index("covariance")])
    with pytest.raises(ModelError, match="cut off"):
        load_responses(path)
    path.write_text(text.replace("kind: loop", "kind: 7"))
    with pytest.raises(ModelError, match="cannot be used"):
        load_responses(path)
