"""Parameters held and freed by name, and what the data cannot tell, in words."""

from dataclasses import replace

import numpy as np
import pytest

from nico_selfmodel.errors import EstimationError
from nico_selfmodel.estimation.arm.kinematics import calibrate_kinematics
from nico_selfmodel.estimation.initialization.nominal_arm import NominalArm
from nico_selfmodel.estimation.judging import judge, to_json
from nico_selfmodel.estimation.results.fixed_parameters import FixedParameters, priors_of
from nico_selfmodel.model.arm.dh_table import DhTable

from ..slow_rest import slow_rest

SIGMA = 3e-4


@pytest.fixture(scope="module")
def learn(make_truth, joined):
    """Return a function: truth, pin words, free words -> calibration with held-out poses."""

    def run(truth, pin=(), free=(), **options):
        circles = truth.dataset(*truth.sweeps(12), sigma=SIGMA, seed=1)
        train = joined(circles, truth.dataset(truth.poses(60, 1), sigma=SIGMA, seed=2))
        test = truth.dataset(truth.poses(60, 2), sigma=SIGMA, seed=3)
        return calibrate_kinematics(
            train, test=test, pins=FixedParameters.from_text(pin, free), **options
        )

    return run


def table_of(result):
    table = to_json(result, judge(result))["parameters"]
    return {name: entry["value"] for name, entry in table.items()}, table


@pytest.mark.slow
def test_a_pinned_parameter_stays_at_its_value_and_has_no_uncertainty(make_truth, learn):
    truth = make_truth(4, 2, unit="counts", kind="elbow")
    unpinned, _ = table_of(learn(truth))
    result = learn(truth, ["joint_1.r=0.01", "joint_2.alpha"])
    values, table = table_of(result)
    assert values["joint_1.r"] == 0.01
    assert values["joint_2.alpha"] == pytest.approx(unpinned["joint_2.alpha"], abs=1e-9)
    assert result.model.dh.r[1] == 0.01
    for name in ("joint_1.r", "joint_2.alpha"):
        assert (table[name]["free"], table[name]["sigma"]) == (False, 0.0)
        assert name not in result.free
    assert table["joint_0.r"]["sigma"] > 0.0
    assert result.converged


@pytest.mark.slow
def test_a_true_pin_helps_and_a_wrong_one_hurts(make_truth, learn):
    truth = make_truth(4, 2, unit="counts", kind="elbow")
    dh = DhTable.from_chain(truth.chain)
    free = learn(truth)
    right = learn(truth, [f"joint_2.r={dh.r[2]}", f"joint_1.gear={truth.servos.gear[1]}"])
    wrong = learn(truth, [f"joint_2.r={dh.r[2] + 0.02}"])
    assert len(right.free) == len(free.free) - 2
    assert right.test.statistics.rms == pytest.approx(free.test.statistics.rms, rel=0.03)
    assert wrong.test.statistics.rms > 1.8 * free.test.statistics.rms
    assert wrong.model.noise_sigma > 1.8 * SIGMA
    assert right.contradicted_parameters == free.contradicted_parameters == ()
    assert judge(right).status == "PASS"
    (pin,) = wrong.contradicted_parameters
    assert (pin.name, pin.value) == ("joint_2.r", dh.r[2] + 0.02)
    assert pin.wanted == pytest.approx(dh.r[2], abs=2e-3)
    assert pin.rise > 1.8
    verdict = judge(wrong)
    assert verdict.status == "FAIL"
    assert "`joint_2.r` is fixed at" in verdict.reasons[0]
    assert "contradicts the data" in verdict.reasons[0]


@pytest.mark.slow
def test_only_the_wrong_one_of_several_pins_is_named(make_truth, learn):
    truth = make_truth(4, 2, unit="counts", kind="elbow")
    dh = DhTable.from_chain(truth.chain)
    pins = [f"joint_2.r={dh.r[2]}", f"joint_1.D={dh.D[1] + 0.015}", "joint_0.D=0.1"]
    result = learn(truth, [*pins, f"joint_1.gear={truth.servos.gear[1]}"])
    assert [pin.name for pin in result.contradicted_parameters] == ["joint_1.D"]
    gears = learn(truth, [f"joint_{i}.gear={1.2 * g}" for i, g in enumerate(truth.servos.gear)])
    assert gears.contradicted_parameters
    assert {pin.name for pin in gears.contradicted_parameters} <= {
        f"joint_{i}.gear" for i in range(4)
    }


@pytest.mark.slow
def test_true_pins_are_hardly_ever_called_wrong(make_truth):
    truth = make_truth(3, 2, unit="counts", kind="elbow")
    dh = DhTable.from_chain(truth.chain)
    pins = FixedParameters.from_text([f"joint_1.r={dh.r[1]}", f"joint_1.alpha={dh.alpha[1]}"])
    for seed in range(12):
        data = truth.dataset(*truth.sweeps(8), sigma=SIGMA, seed=seed)
        result = calibrate_kinematics(data, pins=pins, starts=0)
        assert result.contradicted_parameters == (), seed


@pytest.mark.slow
def test_gears_are_pinned_by_name_too(make_truth, learn):
    truth = make_truth(4, 2, unit="counts", kind="elbow")
    values, table = table_of(learn(truth, ["joint_3.gear=1.1", "joint_1.gear"]))
    assert values["joint_3.gear"] == 1.1
    assert not table["joint_1.gear"]["free"]
    assert values["joint_1.gear"] == pytest.approx(truth.servos.gear[1], rel=0.02)
    assert table["joint_0.gear"]["free"]


@pytest.mark.slow
def test_freed_gears_of_joint_angle_encoders_are_learned(make_truth, learn):
    truth = make_truth(4, 2)
    geared = replace(truth, servos=replace(truth.servos, gear=np.array([1.0, 1.03, 0.96, 1.0])))
    held = learn(geared)
    assert not any(name.endswith(".gear") for name in held.free)
    assert held.model.servos.gear.tolist() == [1.0] * 4
    assert judge(held).status == "FAIL"
    assert {gear.name for gear in held.doubtful_gears} == {"joint_1.gear", "joint_2.gear"}
    freed = learn(geared, free=["joint_1.gear", "joint_2.gear"])
    assert freed.model.servos.gear == pytest.approx(geared.servos.gear, abs=4e-3)
    assert freed.model.servos.gear[[0, 3]].tolist() == [1.0, 1.0]
    assert freed.test.statistics.rms < 0.2 * held.test.statistics.rms
    assert judge(freed).status == "PASS"


@pytest.mark.parametrize(
    ("name", "word"),
    slow_rest(
        [
            ("joint_3.alpha", "twist to the next axis"),
            ("joint_0.D", "along its axis"),
            ("joint_0.theta_offset", "encoder zero"),
        ]
    ),
)
def test_a_freed_gauge_is_unobservable_named_in_words_and_fails(make_truth, learn, name, word):
    truth = make_truth(4, 2, unit="counts", kind="elbow")
    result = learn(truth, free=[name])
    verdict = judge(result)
    assert verdict.status == "FAIL"
    assert name in result.free
    (unobservable,) = result.uncertainty.unobservable
    assert name in unobservable.names
    document = to_json(result, verdict)
    (words,) = document["not_identifiable"]
    assert words in verdict.reasons
    assert f"`{name}`" in words
    assert word in words or "base of the chain" in words
    assert document["parameters"][name]["sigma"] is None
    # What can be told is told all the same.
    assert result.test.statistics.rms < 3.0 * SIGMA
    assert document["parameters"]["joint_1.gear"]["sigma"] < 0.01


@pytest.mark.slow
@pytest.mark.parametrize("seed", [2, 3, 4])
def test_a_hand_on_the_last_axis_makes_the_last_joint_unobservable(
    make_truth, hand_on_last_axis, learn, seed
):
    truth = hand_on_last_axis(make_truth(4, seed, unit="counts"), 0.0)
    result = learn(truth)
    document = to_json(result, judge(result))
    assert document["status"] == "FAIL"
    assert any("joint_3" in words for words in document["not_identifiable"])
    assert truth.errors(result.model, truth.poses(50)).max() < 4.0 * SIGMA
    # The last gear fits noise: it has no uncertainty, or one that covers the truth.
    gear = document["parameters"]["joint_3.gear"]
    off = abs(gear["value"] - truth.servos.gear[3])
    assert gear["sigma"] is None or off < 8.0 * gear["sigma"], gear


@pytest.mark.slow
def test_a_joint_that_hardly_moved_is_unobservable(make_truth):
    truth = make_truth(4, 2, unit="counts", kind="elbow")
    q = truth.poses(80, 1)
    q[:, 2] = 0.3 + 5e-4 * np.random.default_rng(0).normal(size=80)
    result = calibrate_kinematics(truth.dataset(q, sigma=SIGMA), starts=1)
    verdict = judge(result)
    assert verdict.status == "FAIL"
    assert any("joint_2." in reason for reason in verdict.reasons)


@pytest.mark.parametrize(
    ("name", "hint"),
    [("joint_1.gaer", "did you mean 'joint_1.gear'"), ("knee", "there are M0.x")],
)
def test_an_unknown_name_is_answered_with_a_suggestion(make_truth, learn, name, hint):
    truth = make_truth(3, 2)
    for words in ({"pin": [name]}, {"free": [name]}):
        with pytest.raises(ValueError, match=f"no parameter '{name}'.*{hint}"):
            learn(truth, **words)


@pytest.mark.parametrize(
    ("pin", "free", "message"),
    [
        (["a.r=long"], [], "--fix a.r=long: 'long' is not a number"),
        (["a.r="], [], "'' is not a number"),
        (["a.r=nan"], [], "not a finite number"),
        (["a.r"], ["a.r"], "a.r: fixed and freed at once"),
        (["a.alpha=90"], [], "--fix a.alpha=90: 90 rad is more than a turn; .* give 1.5708"),
        (["a.r=250"], [], "--fix a.r=250: 250 m is far; if these are mm, give 0.25"),
        (["left.fx=0.004"], [], "--fix left.fx=0.004: focal lengths are in pixels"),
        (["a.gear=0"], [], "--fix a.gear=0: gears are positive; .* say sign: -1"),
        (["a.r=0.1", "a.r=0.2"], [], "--fix a.r is given twice; leave out one of them"),
    ],
)
def test_words_that_make_no_sense_are_refused(pin, free, message):
    with pytest.raises(ValueError, match=message):
        FixedParameters.from_text(pin, free)


def test_a_prior_in_another_unit_is_refused():
    with pytest.raises(ValueError, match=r"--prior hand.x=150,2: 150 m is far"):
        priors_of(["hand.x=150,2"])
    assert priors_of(["hand.x=0.15,0.002"]) == {"hand.x": (0.15, 0.002)}


def test_words_at_the_edge_of_their_units_are_taken():
    words = ["a.alpha=-6.28", "a.r=20", "left.fx=1", "a.theta_offset=40"]
    values = FixedParameters.from_text(words).pinned.values()
    assert list(values) == [-6.28, 20.0, 1.0, 40.0]


def test_words_are_read_as_names_and_values():
    pins = FixedParameters.from_text(["a.r=0", " b.gear = 1.5 ", "c.D"], ["d.gear"])
    assert pins.pinned == {"a.r": 0.0, "b.gear": 1.5, "c.D": None}
    assert pins.names == {"a.r", "b.gear", "c.D", "d.gear"}
    assert not pins.only_gears
    assert FixedParameters.from_text(["b.gear"], ["d.gear"]).only_gears


def test_a_pin_without_a_value_takes_the_robots(make_truth, learn):
    truth = make_truth(4, 2, kind="elbow")
    wrong = replace(truth.chain, points=truth.chain.points + 0.004)
    shift = np.array([[0.0] * 3, [0.003] * 3, [0.0] * 3, [0.0] * 3])
    wrong = replace(wrong, points=wrong.points + shift)
    nominal = NominalArm(wrong, np.full(4, -3.0), np.full(4, 3.0))
    values, _ = table_of(learn(truth, ["joint_1.r", "joint_2.D", "joint_3.gear"], nominal=nominal))
    table = DhTable.from_chain(wrong)
    assert values["joint_1.r"] == pytest.approx(table.r[1], abs=1e-12)
    assert values["joint_2.D"] == pytest.approx(table.D[2], abs=1e-12)


@pytest.mark.parametrize(
    ("seed", "pin"),
    slow_rest(
        [
            (7, "joint_2.gear=3"),
            (10, "joint_1.D=1"),
            (20, "joint_2.gear=3"),
        ]
    ),
)
def test_a_pin_that_contradicts_the_data_ends_in_a_verdict_or_names_itself(make_truth, seed, pin):
    truth = make_truth(4, seed, unit="counts", kind="elbow")
    data = truth.dataset(truth.poses(25, seed, span=0.8), sigma=1e-3, seed=seed)
    try:
        result = calibrate_kinematics(data, pins=FixedParameters.from_text([pin]), starts=1)
    except EstimationError as error:
        assert pin.partition("=")[0] in str(error)  # noqa: PT017
    else:
        assert (result.model.servos.gear > 0.0).all()
        assert judge(result).status != "PASS"


@pytest.mark.slow
def test_pinning_what_points_cannot_tell_changes_the_words_and_not_the_arm(make_truth, learn):
    truth = make_truth(4, 2, unit="counts", kind="elbow")
    plain = learn(truth)
    moved = learn(truth, ["joint_0.D=0.2", "joint_3.alpha=0.5"])
    values, _ = table_of(moved)
    assert values["joint_0.D"] == 0.2
    q = truth.servos.to_encoder(truth.poses(30))
    assert moved.model.predict(q).p_WH == pytest.approx(plain.model.predict(q).p_WH, abs=1e-7)
