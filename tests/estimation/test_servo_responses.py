"""How joints follow their commands, learned from steps."""

from dataclasses import replace

import numpy as np
import pytest

from nico_selfmodel.errors import NotIdentifiableError
from nico_selfmodel.estimation.judging import judge, result_of, to_json
from nico_selfmodel.estimation.response import step_fit
from nico_selfmodel.estimation.response.servo_calibration import calibrate_servos
from nico_selfmodel.estimation.response.servo_result import MOST_OVERSHOOT, MOST_UNEXPLAINED
from nico_selfmodel.model.response.servo_response import ServoResponse

from ..simulated_steps import SERVOS, steps_recorded


@pytest.fixture(scope="module")
def learned():
    return calibrate_servos(steps_recorded(seed=1, count=14), fraction=0.3)


def _numbers(calibration):
    """Return value and sigma of each parameter that is known, by name."""
    found = result_of(calibration).parameters
    return {name: (one.value, one.sigma) for name, one in found.items() if one.free}


def test_each_kind_of_response_is_told_and_its_numbers_are_found(learned):
    assert judge(learned).status == "PASS"
    known = _numbers(learned)
    for true, found in zip(SERVOS, learned.model.joints, strict=True):
        assert (found.kind, set(found.parts)) == (true.kind, set(true.parts))
        for part, value in {"delay": true.delay, **true.parts}.items():
            told, sigma = known[f"{true.joint}.{part}"]
            assert abs(told - value) < 4.0 * sigma, (true.joint, part)
            assert sigma < (0.15 if part == "delay" else 0.05) * value


def test_what_steps_do_not_show_has_no_value_and_is_said(learned):
    verdict, document = judge(learned), to_json(learned, judge(learned))
    assert document["parameters"]["gripper.speed"]["value"] is None
    assert document["parameters"]["shoulder.rate"]["value"] is None
    assert "gripper.acceleration" not in document["parameters"]
    assert [text for text in verdict.warnings if "does not reach its largest speed" in text] == [
        next(text for text in verdict.warnings if text.startswith("gripper"))
    ]


@pytest.mark.slow
def test_sigmas_cover_what_recordings_differ_by():
    scores, shapes = [], []
    for seed in range(300, 330):
        found = calibrate_servos(steps_recorded(seed=seed))
        known = _numbers(found)
        for true, one in zip(SERVOS, found.model.joints, strict=True):
            shapes.append((one.kind, set(one.parts)) == (true.kind, set(true.parts)))
            if shapes[-1]:
                told = {"delay": true.delay, **true.parts}
                scores += [
                    (known[f"{true.joint}.{part}"][0] - value) / known[f"{true.joint}.{part}"][1]
                    for part, value in told.items()
                ]
    assert np.mean(shapes) > 0.9
    assert 0.8 < np.sqrt(np.mean(np.square(scores))) < 1.25


def test_readings_that_scatter_hide_no_step():
    data = steps_recorded(SERVOS[:1], 14, unit="deg")
    noise = np.random.default_rng(0).normal(0.0, 0.1, np.shape(data.encoders))
    found = calibrate_servos(replace(data, encoders=data.encoders + noise))
    assert found.joints[0].steps.unused == 0
    assert found.joints[0].steps.sigma.min() == pytest.approx(np.radians(0.1), rel=0.2)
    for name, (value, sigma) in _numbers(found).items():
        true = {"delay": 0.04, "speed": 1.0, "acceleration": 4.0}[name.partition(".")[2]]
        assert abs(value - true) < 4.0 * sigma


def test_a_response_that_takes_its_time_is_followed_to_its_minimum(monkeypatch):
    data = steps_recorded(SERVOS[1:2], 20, count=8)
    whole = calibrate_servos(data)
    monkeypatch.setattr(step_fit, "_STEPS", 12)  # of which some first guesses need more
    found = calibrate_servos(data)
    assert result_of(found).converged
    assert found.model.joints[0].rate == pytest.approx(whole.model.joints[0].rate, rel=1e-3)


@pytest.mark.slow
@pytest.mark.parametrize("unit", ["deg", "rad"])
def test_the_unit_of_the_encoder_makes_no_difference(unit):
    counts, other = (
        calibrate_servos(steps_recorded(SERVOS[1:2], 2, unit=one)) for one in ("counts", unit)
    )
    for name, (value, _) in _numbers(counts).items():
        assert _numbers(other)[name][0] == pytest.approx(value, rel=0.02)


@pytest.mark.slow
def test_nothing_held_out_is_not_evaluated_and_a_second_recording_is_held_out():
    servos = SERVOS[:1]
    train, test = (steps_recorded(servos, seed) for seed in (3, 4))
    assert judge(calibrate_servos(train)).status == "NOT_EVALUATED"
    found = calibrate_servos(train, test)
    assert judge(found).status == "PASS"
    assert to_json(found, judge(found))["test"]["angle_deg"]["rms"] < 0.5
    slower = steps_recorded([replace(servos[0], speed=0.4, acceleration=2.0)], 5)
    assert judge(calibrate_servos(train, slower)).status == "FAIL"
    with pytest.raises(ValueError, match="other joints"):
        calibrate_servos(train, steps_recorded(SERVOS[1:2], 4))


@pytest.mark.parametrize("throughout", [False, True])
def test_a_step_in_which_the_joint_was_held_is_set_aside(throughout):
    data = steps_recorded(SERVOS[:1], 6)
    read = np.array(data.encoders)
    rows = np.flatnonzero(np.isnan(read[:, 0]))
    if throughout:
        read[rows[4] :] -= read[rows[4] - 1] - read[rows[3] - 1]
        read[rows[3] + 1 : rows[4]] = read[rows[3] - 1]
    else:
        read[rows[3] + 8 : rows[3] + 30] = read[rows[3] + 8]
    found = calibrate_servos(replace(data, encoders=read))
    assert found.joints[0].outliers.tolist() == [k == 3 for k in range(12)]
    assert found.model.joints[0].speed == pytest.approx(1.0, rel=0.02)
    assert to_json(found, judge(found))["outliers"][0].startswith("shoulder at ")


def _wrong(data, **changes):
    verdict = judge(calibrate_servos(replace(data, **changes)))
    assert verdict.status == "FAIL"
    return verdict.reasons[0]


def test_what_does_not_go_where_it_is_told_is_named_by_its_cause():
    data = steps_recorded(SERVOS[:2], 7)
    told, read = np.array(data.commanded), np.array(data.encoders)
    assert "goes the other way" in _wrong(data, encoders=-read)
    assert "2 times as far" in _wrong(data, encoders=2.0 * read)
    assert "shoulder does not move" in _wrong(data, encoders=read * [0.0, 1.0])
    assert "told to move and elbow moves" in _wrong(data, encoders=read[:, ::-1])
    late = np.vstack([told[:1]] * 3 + [told[:-3]])  # 60 ms where the delay is 40
    assert "the clocks of commands and readings differ" in _wrong(data, commanded=late)


@pytest.mark.parametrize(
    ("ratio", "right"), [(0.88, False), (0.92, True), (1.08, True), (1.13, False)]
)
def test_a_way_that_is_a_tenth_too_long_or_short_is_no_response(ratio, right):
    data = steps_recorded(SERVOS[:1], 8, count=8)
    found = calibrate_servos(replace(data, encoders=ratio * np.array(data.encoders)))
    assert bool(found.joints) is right


def _swinging(size):
    """Return how a joint moves that swings about where it goes by a share of its way."""

    def moves(response, way, time):
        shown = np.maximum(time - response.delay, 0.0)
        swing = size * way * np.sin(25.0 * shown) * np.exp(-4.0 * shown)
        return response.after(way, time) + swing * (shown > 0.0)

    return moves


def test_motion_that_no_response_explains_fails_and_one_that_some_explains_does_not():
    found = {
        size: calibrate_servos(
            steps_recorded(SERVOS[3:], 9, count=8, largest=60.0, moves=_swinging(size))
        )
        for size in (0.05, 0.4)
    }
    little, much = (found[size].joints[0].unexplained for size in (0.05, 0.4))
    assert little < MOST_UNEXPLAINED < much
    assert not any("no response explains" in text for text in judge(found[0.05]).reasons)
    assert "no response explains how gripper moves" in judge(found[0.4]).reasons[0]


def _swings_past(damping):
    """Return how a loop of second order moves; it goes too far by exp(-pi d / (1 - d^2)^1/2)."""

    def moves(response, way, time):
        u, w = 12.0 * np.maximum(time - response.delay, 0.0), np.sqrt(1.0 - damping**2)
        return way * (1.0 - np.exp(-damping * u) * (np.cos(w * u) + damping / w * np.sin(w * u)))

    return moves


@pytest.mark.parametrize(("damping", "warned"), [(0.75, False), (0.65, True)])
def test_a_joint_that_goes_too_far_before_it_comes_back_is_a_warning(damping, warned):
    moves = _swings_past(damping)
    found = calibrate_servos(steps_recorded(SERVOS[3:], 10, count=8, largest=60.0, moves=moves))
    assert (found.joints[0].overshoot > MOST_OVERSHOOT) is warned
    words = " ".join(result_of(found).texts("warning"))
    assert ("too far before it comes back" in words) is warned


def test_what_cannot_tell_a_response_is_refused_with_what_to_do():
    data = steps_recorded(SERVOS[:1], 11, count=4)
    still = np.zeros_like(data.commanded)
    with pytest.raises(NotIdentifiableError, match="no command of any joint changes"):
        calibrate_servos(replace(data, commanded=still))
    stream = np.cumsum(np.ones_like(data.commanded), axis=0)
    with pytest.raises(NotIdentifiableError, match="commands change at once and then stay"):
        calibrate_servos(replace(data, commanded=stream))
    never = np.where(np.arange(len(data))[:, None] % 40 == 0, data.encoders, np.nan)
    with pytest.raises(NotIdentifiableError, match="read the joint more often"):
        calibrate_servos(replace(data, encoders=never))


def test_commands_that_are_much_too_late_are_said_to_have_another_clock():
    data = steps_recorded(SERVOS[:1], 13, count=6)
    late = np.vstack([data.commanded[:1]] * 14 + [data.commanded[:-14]])
    with pytest.raises(NotIdentifiableError, match="commands and readings have one clock"):
        calibrate_servos(replace(data, commanded=late))


def test_too_slow_a_joint_is_not_judged_by_steps_that_it_did_not_finish():
    slow = ServoResponse("slow", "loop", 0.02, 0.0, 0.05, None, 8.0)
    with pytest.raises(NotIdentifiableError, match="end before the joint rests"):
        calibrate_servos(steps_recorded([slow], 12, count=6, largest=40.0))
