"""A whole body that changed says what: a marker, an encoder, a joint of the head, a camera."""

from dataclasses import replace

import numpy as np
import pytest

from nico_selfmodel.errors import ModelError
from nico_selfmodel.estimation.monitoring.body_health import check_body_health
from nico_selfmodel.estimation.monitoring.body_relearning import relearn_body
from nico_selfmodel.estimation.tree.tree_calibration import calibrate_tree
from nico_selfmodel.estimation.tree.tree_errors import errors_of
from nico_selfmodel.estimation.tree.tree_result import body_model
from nico_selfmodel.geometry.rotation import rotation_from_vector
from nico_selfmodel.geometry.transform import transform
from nico_selfmodel.model.arm.bending import SAG, Bending
from nico_selfmodel.model.tree.body_model import BodyModel
from nico_selfmodel.model.tree.spread_weight import tree_rods
from nico_selfmodel.model.tree.tree_motion import TreeMotion
from nico_selfmodel.sessions import whole_body
from nico_selfmodel.systems.simulated.imperfections import IMPERFECTIONS

SEED = 10
WORLD = IMPERFECTIONS["thesis"]


@pytest.fixture(scope="module")
def model():
    train = whole_body.whole_body_session(WORLD, SEED, 0, looks=40, hands=60)
    return body_model(calibrate_tree(train, effects=()))


def day(monkeypatch, session, change=lambda tree: tree):
    """Record a robot that changed since it was learned."""
    nico, tree = whole_body.whole_nico(WORLD, SEED)
    other = change(tree)
    nico = replace(nico, mechanics=replace(nico.mechanics, tree=other))
    with monkeypatch.context() as patched:
        patched.setattr(whole_body, "whole_nico", lambda *_: (nico, other))
        return whole_body.whole_body_session(WORLD, SEED, session, looks=5, hands=15)


def marker_moved(tree):
    shift = transform(np.eye(3), np.array([0.008, 0.0, 0.0]))
    return tree.with_markers(
        tuple(
            replace(m, X_LA=m.X_LA @ shift) if m.name == "right_finger_tip" else m
            for m in tree.markers
        )
    )


def head_hit(tree):
    X = tree.X_PJ.copy()
    i = tree.joints.index("neck_roll")
    X[i] = X[i] @ transform(rotation_from_vector(np.array([0.03, 0.03, 0.0])), np.zeros(3))
    return replace(tree, X_PJ=X)


def camera_turned(tree):
    turn = transform(rotation_from_vector(np.array([0.03, 0.0, 0.02])), np.zeros(3))
    left, right = tree.sensors
    return replace(tree, sensors=(left, replace(right, X_LA=right.X_LA @ turn)))


@pytest.mark.slow
def test_innovations_of_a_body_that_is_as_it_was_are_as_large_as_it_says(model, monkeypatch):
    reports = [check_body_health(model, day(monkeypatch, session)) for session in range(11, 15)]
    assert {report.noise.poses for report in reports} == {model.expected["px"]["n"]}
    square = sum(r.nis.sum() for r in reports) / sum(r.dof.sum() for r in reports)
    assert 0.85 < square < 1.15


@pytest.mark.slow
def test_a_body_that_is_as_it_was_raises_no_alarm(model, monkeypatch):
    for session in range(2, 6):
        assert check_body_health(model, day(monkeypatch, session)).healthy


@pytest.mark.slow
@pytest.mark.parametrize(
    ("change", "cause"),
    [
        (marker_moved, "marker right_finger_tip"),
        (head_hit, "neck_roll on what carries it"),
        (camera_turned, "camera right_wide_camera on its link"),
    ],
)
def test_what_was_hit_is_named_and_learned_alone(model, monkeypatch, change, cause):
    data = day(monkeypatch, 7, change)
    report = check_body_health(model, data)
    assert not report.healthy
    best = report.diagnoses[0].hypothesis
    assert best.cause == cause
    update = relearn_body(model, data, report)
    found, after = update.found, update.model
    assert set(found.setup.free) == set(best.names)
    later = day(monkeypatch, 8, change)
    before, now = (np.nanmean(errors_of(m.tree, later).by_row()) for m in (model, after))
    assert now < before
    assert check_body_health(after, later).healthy


@pytest.mark.slow
def test_an_encoder_that_jumped_is_named(model, monkeypatch):
    data = day(monkeypatch, 9)
    joint = data.joint_names.index("left_elbow")
    readings = data.readings.copy()
    readings[:, joint] += np.radians(3.0) / data.joints[joint].si_per_unit
    report = check_body_health(model, replace(data, readings=readings))
    assert report.diagnoses[0].hypothesis.cause == "zero of left_elbow"
    found = relearn_body(model, replace(data, readings=readings), report).found
    assert found.setup.free == {"left_elbow.rz"}


def shown_by(tree, data, rng):
    """Return a recording with the pixels that a body shows, and noise of 0.3 px."""
    errors, values = errors_of(tree, data), data.observations.values.copy()
    for rows in errors.observations.sensors:
        off = errors.residuals[rows.scalars].reshape(len(rows.rows), -1)
        values[rows.rows, :2] += off + rng.normal(0.0, 0.3, off.shape)
    return replace(data, observations=replace(data.observations, values=values))


@pytest.mark.slow
def test_a_body_that_bends_as_it_was_learned_raises_no_alarm():
    data = whole_body.whole_body_session(IMPERFECTIONS["clean"], 0, 0, looks=5, hands=20)
    _, rigid = whole_body.whole_nico(IMPERFECTIONS["clean"], 0)
    loads = tree_rods(TreeMotion.at(rigid, np.zeros((1, 18))))
    still = Bending.none(rigid.joints, np.array([0.0, 0.0, 1.0]), *loads).with_effects(SAG)
    bent = replace(rigid, bending=still.with_values(np.full(18, 0.5)))
    data = shown_by(bent, data, np.random.default_rng(0))
    noise = {sensor.name: 0.3 for sensor in rigid.sensors}
    bodies = [BodyModel("nico", tree, np.ones(18), noise=noise) for tree in (bent, rigid)]
    assert [check_body_health(body, data).healthy for body in bodies] == [True, False]


@pytest.mark.slow
def test_a_body_that_does_not_say_its_noise_is_not_watched(model, monkeypatch):
    with pytest.raises(ModelError, match="does not say the noise of all that saw"):
        check_body_health(replace(model, noise={}), day(monkeypatch, 9))
