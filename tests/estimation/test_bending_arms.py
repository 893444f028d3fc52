"""The ladder of what bends: arms that sag by Drake's masses keep it, rigid ones keep nothing."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from nico_selfmodel.dataset.folder import load_dataset
from nico_selfmodel.estimation.arm.kinematics import calibrate_kinematics
from nico_selfmodel.estimation.bending import climber
from nico_selfmodel.estimation.bending.bending_arm import BendingArm
from nico_selfmodel.estimation.bending.implausible import COUPLES, LIFTS
from nico_selfmodel.estimation.bending.steps import STEPS
from nico_selfmodel.estimation.judging import judge, result_of, to_json
from nico_selfmodel.estimation.monitoring.health import check_health
from nico_selfmodel.geometry.rotation import rotation_about
from nico_selfmodel.model.arm.uniform_rods import load_sigmas
from nico_selfmodel.planning.next_poses import choose_next_poses

from ..slow_rest import slow_rest
from .sagging_arms import SaggingArm, mean_mm, told


def arm_and_data(seed, poses, **weak):
    rng = np.random.default_rng((seed, 91))
    arm = SaggingArm.drawn(rng, **weak)
    train, _ = arm.recorded(rng, poses)
    test, true = arm.recorded(rng, 100)
    return arm, train, test, true


@cache
def sagged(seed, *, rigid=False):
    """An arm that sags, learned once, as an arm that bends or as a rigid one."""
    _, train, test, _ = arm_and_data(seed, 40)
    how = {"effects": ()} if rigid else {}
    return calibrate_kinematics(train, test=test, explain=False, **how)


def nees(model, test, true):
    """Normalised squared error of the hand at fresh poses, a third of it."""
    index = np.array([int(name[1:]) for name in test.marker])
    found = model.predict(test.encoders, index)
    e = found.p_WH - true
    return float(np.mean(np.einsum("ni,nij,nj->n", e, np.linalg.inv(found.covariance), e))) / 3.0


@pytest.mark.slow
def test_arms_that_sag_are_learned_nearly_as_if_their_masses_were_told():
    beside, normalised = [], []
    for seed in (0, 1, 2):
        arm, train, test, true = arm_and_data(seed, 40)
        rigid, learned = sagged(seed, rigid=True), sagged(seed)
        assert learned.ladder.kept == ("sag",)
        measured = test.p_WH_measured
        now, before = (mean_mm(c.model.parameters, test, measured) for c in (learned, rigid))
        beside.append(now / mean_mm(told(arm, rigid, train), test, measured))
        assert now < 0.4 * before
        assert not learned.outliers.any()
        normalised.append(nees(learned.model, test, true))
        assert learned.model.bending.sag[1] > 0.0
    assert np.mean(beside) < 1.12
    assert 0.7 < np.mean(normalised) < 1.4


@pytest.mark.slow
@pytest.mark.parametrize("seed", [104, 5032])
def test_noise_is_not_a_part_of_what_a_sag_explains(seed):
    """Least noise that is a part of the rigid arm's error made sigmas of these arms twice too
    large."""
    _, train, test, true = arm_and_data(seed, 40)
    learned = calibrate_kinematics(train, explain=False)
    assert learned.noise.sensor_sigma == pytest.approx(1e-4, rel=0.25)
    assert nees(learned.model, test, true) > 0.6


@pytest.mark.slow
def test_a_body_that_bends_doubts_what_did_not_stay(monkeypatch):
    """Without the doubt effects fall to zero, and unseen poses are told too surely."""
    _, train, test, true = arm_and_data(1, 60, bearing=1.0)
    doubts = calibrate_kinematics(train, explain=False).model
    monkeypatch.setattr(climber.Climber, "accompany", lambda self, *asked: None)
    is_sure = calibrate_kinematics(train, explain=False).model
    assert nees(is_sure, test, true) > 1.2 * nees(doubts, test, true)


@pytest.mark.slow
def test_loads_are_held_as_their_geometry_says():
    fit = sagged(1).ladder.fit
    said = load_sigmas(fit.parameters.table)
    held = [fit.priors[f"{joint}.load_{axis}"][1] for joint in fit.parameters.table.joints
            for axis in "xyz"]  # fmt: skip
    assert held == pytest.approx(said.ravel(), rel=0.02)
    assert said.max() > 3.0 * said.min()


@pytest.mark.slow
def test_what_the_data_speak_against_is_doubted_less(monkeypatch):
    """Doubted as much as what may well be there, it costs unseen poses more than it is worth."""
    asks = climber.Climber.accompany
    monkeypatch.setattr(climber.Climber, "accompany", lambda self, e, _: asks(self, e, ()))
    _, train, _, _ = arm_and_data(1, 40)
    alike = calibrate_kinematics(train, explain=False).ladder.fit
    weighed = sagged(1).ladder.fit
    for effect in {"ripple", "coupling"} & set(alike.groups) & set(weighed.groups):
        assert weighed.variance[effect] < 0.5 * alike.variance[effect]
    assert {"ripple", "coupling"} & set(alike.groups) & set(weighed.groups)


@pytest.mark.slow
@pytest.mark.parametrize("poses", slow_rest([40, 20]))
def test_a_rigid_arm_stays_rigid(poses):
    _, train, _, _ = arm_and_data(5, poses, sag=0.0)
    learned = calibrate_kinematics(train, explain=False)
    assert learned.ladder.kept == ()
    assert learned.model.bending is None
    assert learned.model.parameters.bending is None


@pytest.mark.slow
def test_what_goes_beside_hangs_from_the_likeliest_vertical(monkeypatch):
    """An arm whose joint noise hides its sag, and whose first axis lies."""
    lying, upright = np.eye(3)[[0, 2]]
    verticals = ((lying, False), (upright, False))
    monkeypatch.setattr(BendingArm, "ups", property(lambda _: verticals))
    _, train, _, _ = arm_and_data(1, 80, sag=2.0)
    noise = 8e-3 * np.random.default_rng(1).normal(size=train.encoders.shape)
    learned = calibrate_kinematics(replace(train, encoders=train.encoders + noise), explain=False)
    assert "sag" not in learned.ladder.kept
    assert "sag" in learned.model.bending.effects
    assert learned.model.bending.up == pytest.approx(upright)


@pytest.mark.slow
def test_what_is_not_allowed_is_told():
    rigid = sagged(1, rigid=True)
    assert rigid.model.bending is None
    warnings = judge(rigid).warnings
    assert any("would meet unseen poses to" in w and "joints sag by up to" in w for w in warnings)
    document = to_json(result_of(rigid), judge(rigid))
    assert document["bending"]["effects"] == []
    assert document["bending"]["tried"][0]["kept"]


def test_what_bends_is_named_with_its_size():
    learned = sagged(1)
    verdict, block = judge(learned), to_json(result_of(learned), judge(learned))["bending"]
    assert verdict.status == "PASS"
    assert any(reason.startswith("joints sag by up to") for reason in verdict.reasons)
    assert block["effects"] == ["sag"]
    assert block["hand_mm"]["sag"]["max"] > 1.0
    assert set(block["joints_mrad"]["sag"]) == set(learned.model.joints)


@pytest.mark.slow
def test_ripple_is_kept_by_its_name():
    _, train, test, _ = arm_and_data(3, 60, sag=0.0, ripple=2.0)
    learned = calibrate_kinematics(train, explain=False)
    assert "ripple" in learned.ladder.kept
    assert "sag" not in learned.ladder.kept
    rigid = calibrate_kinematics(train, explain=False, effects=())
    assert mean_mm(learned.model.parameters, test, test.p_WH_measured) < 0.6 * mean_mm(
        rigid.model.parameters, test, test.p_WH_measured
    )


@pytest.mark.slow
@pytest.mark.parametrize(("coupled", "kept"), [(0.05, True), (0.2, False)])
def test_coupled_drives_are_kept_or_named_and_taken_for_no_gear(make_truth, coupled, kept):
    truth = make_truth(4, 3)
    data = truth.dataset(truth.poses(70, 4), sigma=3e-4, seed=5)
    encoders = data.encoders.copy()
    encoders[:, 3] -= coupled * encoders[:, 2]
    found = calibrate_kinematics(replace(data, encoders=encoders), explain=False)
    coupling = next(step for step in found.ladder.steps if step.effect == "coupling")
    assert coupling.kept == kept
    if kept:
        values = dict(zip(found.model.parameters.names, found.model.parameters.values, strict=True))
        joints = data.joints
        name = f"{joints[3].name}.coupling_{joints[2].name}"
        angle = coupled * joints[3].sign * joints[2].sign
        assert values[name] == pytest.approx(angle, abs=5e-3)
        assert found.train.distances.mean() < 3.0 * 3e-4
    else:
        assert coupling.reason == COUPLES
        assert any("coupling is not kept" in warning for warning in judge(found).warnings)


@pytest.mark.parametrize(
    ("kind", "seed"), slow_rest([("elbow", 4), ("elbow", 3), ("elbow", 6), ("parallel", 2)])
)
def test_a_gear_that_contradicts_its_unit_is_taken_for_no_sag(make_truth, kind, seed):
    # Over 90 deg of a turn the weight of a lying arm is nearly a line, as a gear is.
    truth = make_truth(3, seed, kind=kind)
    q = truth.poses(60, seed, span=1.6)
    turned = np.array([1.0, 1.04, 1.0]) * q
    turned += np.radians(0.1) * np.random.default_rng(seed).normal(size=q.shape)
    data = truth.dataset(turned, sigma=3e-4, seed=1)
    found = calibrate_kinematics(replace(data, encoders=truth.servos.to_encoder(q)), explain=False)
    assert found.ladder.kept == ()
    (words,) = [said for said in judge(found).reasons if ".gear` is held at 1" in said]
    assert words.startswith("`joint_1.gear`")
    told = float(words.split("ask for about ")[1].split()[0])
    assert told == pytest.approx(1.0 / 1.04, abs=0.006)


@pytest.mark.slow
def test_a_vertical_told_the_wrong_way_round_is_called_implausible():
    _, train, _, _ = arm_and_data(1, 40)
    found = calibrate_kinematics(train, explain=False, up=np.array([0.0, 0.0, -1.0]))
    assert found.ladder.steps[0].reason == LIFTS
    assert found.model.bending is None or "sag" not in found.model.bending.effects
    assert any("it would lift the arm" in warning for warning in judge(found).warnings)


@pytest.mark.slow
def test_only_swept_and_sagging_no_pose_is_set_aside():
    rng = np.random.default_rng((7, 91))
    arm = SaggingArm.drawn(rng, markers=3)
    home = rng.uniform(-0.4, 0.4, 6)
    q = np.repeat(home[None], 36, axis=0)
    for i in range(6):
        q[6 * i : 6 * i + 6, i] = np.linspace(-1.3, 1.3, 6)
    train, _ = arm.recorded(rng, 36, q=q)
    test, _ = arm.recorded(rng, 60, span=0.6)
    rigid = calibrate_kinematics(train, explain=False, effects=())
    learned = calibrate_kinematics(train, explain=False)
    assert "sag" in learned.ladder.kept
    assert not learned.outliers.any()
    now, before = (mean_mm(c.model.parameters, test, test.p_WH_measured) for c in (learned, rigid))
    assert now < 0.5 * before


@pytest.mark.slow
def test_too_few_poses_are_not_asked():
    _, train, _, _ = arm_and_data(0, 14)
    assert calibrate_kinematics(train, explain=False).ladder.steps == ()


@pytest.mark.slow
@pytest.mark.parametrize("name", ["_WORTH", "_GAIN"])
def test_a_threshold_of_the_ladder_decides(monkeypatch, name):
    """Raised beyond all that is told, nothing stays."""
    _, train, _, _ = arm_and_data(1, 40)
    monkeypatch.setattr(climber, name, 1e4)
    assert calibrate_kinematics(train, explain=False).ladder.kept == ()


@pytest.mark.slow
def test_the_positioner_ripples_and_does_not_sag(project_root):
    data = load_dataset(project_root / "examples" / "data" / "positioner_two_axis")
    train, test = data.split(0.3, 0)
    learned = calibrate_kinematics(train, test=test)
    assert 1e3 * learned.test.statistics.rms <= 0.34
    assert "ripple" in learned.ladder.kept
    assert "sag" not in learned.ladder.kept


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(5))
def test_real_arms_are_met_no_worse_than_by_a_rigid_one(project_root, seed):
    for name, most in (("positioner_two_axis", 0.85), ("franka_fr3", 1.03)):
        train, test = load_dataset(project_root / "examples" / "data" / name).split(0.3, seed)
        rigid, learned = (
            calibrate_kinematics(train, test=test, explain=False, effects=effects)
            for effects in ((), STEPS)
        )
        one, two = (c.test.distances for c in (rigid, learned))
        sound = (one < 6.0 * np.median(one)) & (two < 6.0 * np.median(two))
        ratio = np.sqrt(np.mean(two[sound] ** 2) / np.mean(one[sound] ** 2))
        assert ratio <= most, (name, ratio)


@pytest.mark.slow
def test_rigid_arms_keep_nothing_and_sagging_ones_sag():
    kept = [calibrate_kinematics(arm_and_data(s, 40, sag=0.0)[1], explain=False).ladder.kept
            for s in range(50, 80)]  # fmt: skip
    assert sum(bool(k) for k in kept) <= 1, kept
    named = [calibrate_kinematics(arm_and_data(s, 40)[1], explain=False).ladder.kept
             for s in range(50, 70)]  # fmt: skip
    assert sum("sag" in k for k in named) >= 18, named


@pytest.mark.slow
@pytest.mark.parametrize("spoilt", ["worse", "gear turned round"])
def test_an_arm_that_is_no_better_solved_together_stays_rigid(monkeypatch, spoilt):
    solve = BendingArm.bent

    def spoil(*args):
        solved = solve(*args)
        values = np.array(solved.parameters.values)
        turned = spoilt == "gear turned round"
        part = ".gear" if turned else ".theta_offset"
        at = next(i for i, name in enumerate(solved.parameters.names) if name.endswith(part))
        values[at] = -values[at] if turned else values[at] + 0.2
        return replace(solved, parameters=solved.parameters.with_values(values))

    monkeypatch.setattr(BendingArm, "bent", spoil)
    _, train, _, _ = arm_and_data(0, 40)
    learned = calibrate_kinematics(train, explain=False)
    assert learned.model.bending is None
    assert "solved together, the arm is no better" in {s.reason for s in learned.ladder.steps}


@pytest.mark.slow
def test_an_arm_that_sags_is_watched_rezeroed_and_sent_to_new_poses():
    _, train, test, _ = arm_and_data(1, 60)
    model = calibrate_kinematics(train, explain=False).model
    assert check_health(model, test).healthy
    chosen = choose_next_poses(model, train, 10, np.random.default_rng(0))
    assert 0.0 < chosen.sigma_after < chosen.sigma_before
    jumped = model.servos.to_encoder(np.zeros(6)) + np.array([0.0, 0.05, 0.0, 0.0, 0.0, 0.0])
    moved = replace(test, encoders=test.encoders + jumped - model.servos.to_encoder(np.zeros(6)))
    assert not check_health(model, moved).healthy


@pytest.mark.slow
@pytest.mark.parametrize(
    ("poses", "words"),
    slow_rest(
        [
            (14, "ripple is not kept: it was not asked"),
            (40, "ripple is not kept: the data do not tell"),
        ]
    ),
)
def test_an_effect_that_was_asked_for_by_name_says_why_it_went(poses, words):
    _, train, _, _ = arm_and_data(0, poses, sag=0.0)
    found = calibrate_kinematics(train, explain=False, effects=("ripple",))
    assert any(words in warning for warning in judge(found).warnings)


@pytest.mark.slow
@pytest.mark.parametrize("axis", [0, 1])
def test_the_vertical_of_an_arm_on_a_wall_is_found_in_a_tracker_of_any_axes(axis):
    rng = np.random.default_rng((2, 97))
    wall = rotation_about([0.6, 0.8, 0.0], 0.5 * np.pi)
    tracker = rotation_about(np.eye(3)[axis], -0.5 * np.pi)
    arm = SaggingArm.drawn(rng, mounted=wall)
    train, _ = arm.recorded(rng, 40)
    turned = train.p_WH_measured @ tracker.T
    learned = calibrate_kinematics(replace(train, p_WH_measured=turned), explain=False)
    assert learned.ladder.kept == ("sag",)
    assert learned.model.bending.up == pytest.approx(tracker[:, 2])
