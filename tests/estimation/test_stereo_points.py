"""Arms learned through cameras that are themselves uncertain."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from nico_selfmodel.estimation.arm.kinematics import calibrate_kinematics
from nico_selfmodel.estimation.body.stereo_points import StereoPoints
from nico_selfmodel.estimation.cameras.camera_calibration import calibrate_cameras
from nico_selfmodel.estimation.observations.sight_spread import SightSpread
from nico_selfmodel.model.cameras.rig_parameters import rig_names
from nico_selfmodel.model.self_model import ParameterCovariance, SelfModel
from nico_selfmodel.systems.simulated.imperfections import IMPERFECTIONS

from .simulated_boards import RIG
from .simulated_bodies import Truth, body, scenario


def through(cameras, seed=0):
    """Return the cameras' stereo and the arm that is learned through it."""
    stereo = StereoPoints.of(cameras, scenario(seed).train)
    return stereo, calibrate_kinematics(stereo.train, loss="none", starts=3, spread=stereo.spread)


@pytest.mark.parametrize(("boards", "told"), [(0.02, 0.1), (0.3, 0.3), (None, None)])
def test_pixels_of_a_hand_are_as_certain_as_its_sights_meet_and_no_more_than_those_of_boards(
    boards, told
):
    rng = np.random.default_rng(0)
    pixels = RIG.project(rng.uniform([-0.1, -0.1, 0.4], [0.1, 0.1, 0.6], (2000, 3)))
    pixels = pixels + 0.1 * rng.normal(size=pixels.shape)
    pixels[:10, 3] += 30.0  # one camera takes another thing for the hand
    pixels[10:20, :2] = np.nan
    cameras = SimpleNamespace(pixel_sigma=boards, rig=RIG)
    train = SimpleNamespace(pixels=pixels)
    found = StereoPoints(cameras, None, None, {"train": train}, {}).pixel_sigma
    assert found is None if told is None else found == pytest.approx(told, rel=0.05)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "step"), [("right.pose.x", 1e-4), ("left.cx", 0.5), ("right.pose.ry", 1e-3)]
)
def test_an_arm_follows_its_cameras_as_their_covariance_says(name, step):
    cameras = scenario().cameras
    values = cameras.rig.values
    values[rig_names().index(name)] += step
    rig = cameras.rig.with_values(values)
    moved = replace(cameras, cameras={"left": rig.left, "right": rig.right}, covariance=None)
    (stereo, before), (_, after) = through(cameras), through(moved)
    free = before.uncertainty.names
    index = [before.model.parameters.names.index(n) for n in free]
    found = (after.model.parameters.values - before.model.parameters.values)[index] / step
    gain = stereo._gain(before, free, (name,))[:, 0]
    sigma = before.uncertainty.sigma
    # In units of what is not known anyway.
    assert np.linalg.norm(gain / sigma) > 2.0
    np.testing.assert_allclose(found / sigma, gain / sigma, atol=0.03 * np.abs(gain / sigma).max())


@pytest.mark.slow
def test_a_completed_arm_carries_the_uncertainty_of_its_cameras():
    stereo, arm = through(scenario().cameras)
    whole = stereo.complete(arm)
    names = whole.model.covariance.names
    assert names[: len(arm.uncertainty.names)] == arm.uncertainty.names
    assert {"left.fx", "right.k1", "right.pose.x"} <= set(names)
    assert np.all(whole.uncertainty.sigma >= arm.uncertainty.sigma)
    values = np.linalg.eigvalsh(whole.model.covariance.matrix)
    assert values.min() > -1e-9 * values.max()


@pytest.mark.slow
def test_errors_of_arms_learned_by_sight_are_as_large_as_their_sigmas():
    """Points in space: the true hand against the arm, play discounted."""
    before, after = [], []
    for seed in range(8):
        cameras = calibrate_cameras(scenario(seed).boards).self_model("cameras")
        stereo, arm = through(cameras, seed)
        true = Truth.of(body(seed)).parameters
        readings = scenario(seed).test.encoders[:20]
        p = true.table.forward(true.servos.to_joint(readings))
        for model, squares in ((arm.model, before), (stereo.complete(arm).model, after)):
            found = model.predict(readings)
            miss = (found.p_WH - p)[:, :, None]
            squares += (miss.mT @ np.linalg.solve(found.covariance, miss)).ravel().tolist()
    # Without the cameras the arm takes itself for nearly twice as sure as it is.
    assert np.mean(before) / 3.0 > 2.5
    assert 0.5 < np.mean(after) / 3.0 < 1.6


@pytest.mark.slow
def test_cameras_beside_an_arm_that_alone_is_uncertain_count_as_exact():
    stereo, arm = through(scenario().cameras)
    whole = stereo.complete(arm).model
    names = tuple(n for n in whole.covariance.names if n.partition(".")[0] not in ("left", "right"))
    of_arm = ParameterCovariance(names, np.eye(len(names)) * 1e-9)
    stereo, again = through(replace(whole, covariance=of_arm))
    completed = stereo.complete(again)
    assert completed.model.covariance.names == again.uncertainty.names
    np.testing.assert_array_equal(completed.uncertainty.sigma, again.uncertainty.sigma)


@pytest.mark.slow
def test_cameras_without_a_covariance_count_as_exact():
    stereo, arm = through(replace(scenario().cameras, covariance=None))
    whole = stereo.complete(arm)
    assert whole.uncertainty is arm.uncertainty
    assert whole.model.covariance.names == arm.uncertainty.names


NEARLY_STILL = IMPERFECTIONS["clean"].with_noise(play_deg=0.02)


def by_exact_cameras(seed, sigma_px=None):
    """Return what true cameras, as another program states them, make of a hand whose joints have
    hardly any play, and the true body."""
    recorded, one = scenario(seed, world=NEARLY_STILL), body(seed, world=NEARLY_STILL)
    true = Truth.of(one).model()
    cameras = SelfModel("cameras", cameras=true.cameras)
    train = replace(recorded.train, pixel_sigma_px=sigma_px)
    return StereoPoints.of(cameras, train), true, recorded.test


def test_the_spread_of_a_point_is_that_of_its_triangulation():
    rng = np.random.default_rng(3)
    p = rng.uniform([-0.1, -0.1, 0.4], [0.1, 0.1, 0.9], (40, 3))
    spread = SightSpread.of(RIG, p)
    found = RIG.triangulate(RIG.project(p), 1.0).covariance
    np.testing.assert_allclose(spread.covariances(p, p) * spread.unit**2, found, rtol=1e-6)
    # One that cannot be where it should counts where it was seen.
    behind = p * [1.0, 1.0, -1.0]
    np.testing.assert_allclose(spread.covariances(behind, p), spread.covariances(p, p))


@pytest.mark.slow
def test_depth_decides_by_as_much_as_cameras_tell_of_it():
    """A pixel moves a point by far more along the sights than across."""
    errors = np.zeros((2, 4))
    for i in range(4):
        stereo, true, test = by_exact_cameras(4 + i, 0.3)
        for k, spread in enumerate((None, stereo.spread)):
            arm = calibrate_kinematics(
                stereo.train, starts=3, effects=(), explain=False, spread=spread
            ).model
            off = arm.predict(test.encoders).p_WH - true.predict(test.encoders).p_WH
            errors[k, i] = np.mean(off**2)
    before, after = np.sqrt(errors.mean(axis=1))
    assert after < 0.6 * before, errors


def test_cameras_of_other_programs_are_enough_where_nobody_states_what_a_pixel_is_uncertain_by():
    stereo, _, _ = by_exact_cameras(0)
    assert stereo.pixel_sigma is None
    arm = calibrate_kinematics(
        stereo.train, starts=3, effects=(), explain=False, spread=stereo.spread
    )
    model = stereo.complete(arm).model
    assert model.pixel_sigma == pytest.approx(0.3, rel=0.1)
    assert model.noise_mixtures["pixels"].sensor_sigma == pytest.approx(0.3, rel=0.2)
