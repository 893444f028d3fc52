"""A simulated body that sees its hand: what it shows, what it hides, what can happen to it."""

from dataclasses import replace

import numpy as np
import pytest

from nico_selfmodel.experiments.projected_nico import TRACKERS, ProjectedNico
from nico_selfmodel.systems.nico_cameras import NICO_CAMERAS
from nico_selfmodel.systems.simulated.cameras import SimulatedCameras
from nico_selfmodel.systems.simulated.imperfections import IMPERFECTIONS
from nico_selfmodel.systems.simulated.robot import SimulatedRobot
from nico_selfmodel.systems.simulated.sensors import StereoPixels

from .test_truth_stays_hidden import numbers_in

CLEAN = IMPERFECTIONS["clean"]


@pytest.fixture(scope="module")
def protocol():
    return ProjectedNico.tracked_by()


@pytest.fixture
def body(protocol):
    return protocol.robot(CLEAN, 5)


def hidden(body):
    """Return chain, servos, head and cameras."""
    truth = body.ground_truth.instance
    return [truth.mechanics.chain, truth.mechanics.servos, truth.X_BL, truth.rig]


def commands(protocol, body, count, seed=0):
    low = np.array([joint.lower for joint in body.joints])
    high = np.array([joint.upper for joint in body.joints])
    q = protocol.random_poses(count, np.random.default_rng(seed))
    share = (q - protocol.arm.lower) / (protocol.arm.upper - protocol.arm.lower)
    return low + share * (high - low)


def test_no_public_number_is_one_of_the_truth(protocol, body):
    chain, servos, X_BL, rig = hidden(body)
    truth = [chain.directions, chain.points, chain.p_WH_zero, servos.gear, servos.offset]
    truth += [X_BL[:3], rig.values]
    truth = np.concatenate([np.ravel(part) for part in truth])
    truth = truth[np.abs(truth - np.round(truth)) > 1e-6]
    seen = [body.move_and_measure(c) for c in commands(protocol, body, 20)]
    shown = numbers_in(body) + [x for one in seen for x in numbers_in(one)]
    assert len(truth) > 50
    assert len(shown) > 100
    assert np.abs(np.array(shown)[:, None] - truth).min() > 1e-7


def test_what_a_learner_gets_is_encoders_and_pixels(protocol, body):
    observation = body.move_and_measure(commands(protocol, body, 1)[0])
    assert observation.points == {"hand": None}
    assert observation.images is None
    assert not observation.reflected
    assert set(observation.pixels) == {"hand"}
    with pytest.raises(TypeError):
        observation.pixels["hand"] = np.zeros(4)


def test_ground_truth_has_the_hand_where_the_true_cameras_see_it(protocol, body):
    body.sensor = StereoPixels(0.0)
    rig = hidden(body)[3]
    for command in commands(protocol, body, 5):
        observation, p_LH = body.move_and_measure(command), body.ground_truth.p_LH
        assert observation.pixels["hand"] == pytest.approx(rig.project(p_LH[0]), abs=1e-9)
    np.testing.assert_allclose(rig.left.X_WC, np.eye(4), atol=1e-15)


def test_its_cameras_are_those_that_look_at_boards(body):
    points = np.array([[0.0, 0.0, 0.0], [0.05, 0.0, 0.0], [0.0, 0.05, 0.0]])
    views = SimulatedCameras(5, pixel_sigma=0.0).look_at_boards(points, 2)
    for pixels in views.pixels:
        corner, *others = hidden(body)[3].triangulate(pixels, 0.1).p_WQ
        assert np.linalg.norm(others - corner, axis=1) == pytest.approx([0.05, 0.05], abs=1e-7)


def test_the_individual_is_not_what_its_description_says(protocol, body):
    chain, servos, X_BL, rig = hidden(body)
    assert np.linalg.norm(chain.points - protocol.arm.chain.points, axis=1).min() > 1e-5
    assert np.linalg.norm(X_BL[:3, 3] - protocol.workspace.rig.left.X_WC[:3, 3]) > 1e-4
    assert abs(rig.left.cx - NICO_CAMERAS.left.cx) > 1e-2
    assert np.abs(servos.offset).min() > 1e-3


@pytest.mark.slow
def test_noise_is_as_stated_and_what_lies_outside_an_image_is_not_seen(protocol):
    noisy = ProjectedNico.tracked_by("color").robot(CLEAN, 5)
    assert noisy.sensor.sigma == TRACKERS["color"] == 2.0
    command = commands(protocol, noisy, 1)[0]
    seen = np.array([noisy.move_and_measure(command).pixels["hand"] for _ in range(400)])
    assert seen.std(axis=0) == pytest.approx([2.0] * 4, rel=0.15)
    low = np.array([joint.lower for joint in noisy.joints])
    high = np.array([joint.upper for joint in noisy.joints])
    anywhere = np.random.default_rng(0).uniform(low, high, (200, 4))
    found = np.array([noisy.move_and_measure(c).pixels["hand"] for c in anywhere])
    by_camera = np.isfinite(found).reshape(-1, 2, 2)
    assert np.array_equal(by_camera[:, :, 0], by_camera[:, :, 1])
    assert 0.1 < by_camera.all(axis=(1, 2)).mean() < 0.5
    assert (by_camera.any(axis=2).sum(axis=1) == 1).any()
    inside = found[np.isfinite(found).all(axis=1)]
    assert (inside > 0.0).all()
    assert (inside < np.array([640.0, 480.0] * 2)).all()


@pytest.mark.parametrize(
    ("what", "arguments"),
    [
        ("slip", ("right_elbow", 0.05)),
        ("change_gear", ("right_elbow", 1.05)),
        ("take_tool", ([0.0, 0.02, -0.05],)),
        ("bump_camera", ([0.01, 0.0, 0.0],)),
        ("restart", (3,)),
    ],
)
def test_whatever_happens_to_it_shows_in_its_pixels(protocol, what, arguments):
    before, after = (replace_noise(protocol.robot(CLEAN, 5)) for _ in range(2))
    command = commands(protocol, before, 1, seed=4)[0]
    getattr(after.faults, what)(*arguments)
    reading = np.clip(
        command, *(np.array([getattr(j, e) for j in after.joints]) for e in ("lower", "upper"))
    )
    one, other = (b.move_and_measure(reading).pixels["hand"] for b in (before, after))
    moved = np.abs(one - other)
    assert np.nanmax(moved) > 1.0
    if what == "bump_camera":
        assert moved[:2] == pytest.approx([0.0, 0.0], abs=1e-9)


def replace_noise(body):
    body.sensor = StereoPixels(0.0)
    return body


def test_a_slip_is_read_at_the_stops_too_and_turns_the_joint_by_as_much(protocol, body):
    servos = hidden(body)[1]
    low = body.joints[3].lower
    command = commands(protocol, body, 1)[0]
    q = servos.to_joint(np.round(command))
    body.faults.slip("right_elbow", 0.1)
    assert hidden(body)[1].to_joint(np.round(command)) - q == pytest.approx([0.0, 0.0, 0.0, 0.1])
    counts = 0.1 * servos.gear[3] * CLEAN.counts_per_turn / (2.0 * np.pi)
    assert low - body.joints[3].lower == pytest.approx(counts, abs=2.0)
    with pytest.raises(ValueError, match="no joint 'elbow'"):
        body.faults.slip("elbow", 0.1)


def test_ground_truth_measures_the_links(body):
    upper, lower = body.ground_truth.link_lengths()
    assert upper == pytest.approx(0.13, abs=0.008)
    assert lower == pytest.approx(0.143, abs=0.008)


def test_play_comes_back_in_every_session_and_differs_between_them(protocol):
    playful = replace(CLEAN, play=np.radians(0.5))
    a, b, c = (protocol.robot(playful, 5, session) for session in (0, 0, 1))
    command = commands(protocol, a, 1)[0]
    for one in (a, b, c):
        one.move_and_measure(command)
    first, second, third = (one.ground_truth.p_LH for one in (a, b, c))
    assert np.array_equal(first, second)
    assert 1e-5 < np.linalg.norm(first - third) < 1e-2


def test_commands_and_stops_that_are_none_are_refused(protocol, body):
    with pytest.raises(ValueError, match="finite counts"):
        body.move_and_measure([1.0, 2.0])
    with pytest.raises(ValueError, match="finite counts"):
        body.move_and_measure([np.nan] * 4)
    arm = protocol.arm
    with pytest.raises(ValueError, match="finite lower < upper"):
        SimulatedRobot.with_cameras(
            replace(arm, lower=arm.upper, upper=arm.lower), np.eye(4), CLEAN, 0, pixel_sigma=0.3
        )
    with pytest.raises(ValueError, match="no tracker"):
        ProjectedNico.tracked_by("touch")


def test_poses_are_planned_in_view_and_sweeps_share_home(protocol, body):
    labels, q = protocol.sweeps(15)
    assert len(labels) == len(q) == 61
    assert protocol.workspace.in_view(q).all()
    moving = np.abs(q[1:] - q[0]) > 1e-12
    joints = np.array(protocol.arm.joints)
    for label, row in zip(labels[1:], moving, strict=True):
        assert set(joints[row]) <= {label}
    assert np.ptp(np.degrees(q), axis=0).min() > 45.0
    data = protocol.record(body, "swept", q, labels)
    assert np.isfinite(data.pixels).all(axis=1).mean() > 0.95
    assert np.isnan(data.p_WH_measured).all()
    assert data.pixel_sigma_px == 0.3
