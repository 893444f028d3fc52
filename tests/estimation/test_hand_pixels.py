"""Residuals of the hand's pixels and points: derivatives, gaps, the plant as a second opinion."""

from dataclasses import replace

import numpy as np
import pytest

from nico_selfmodel.errors import DataError
from nico_selfmodel.estimation.observations.hand_rows import (
    HandPixels,
    HandPoints,
    project_to_cameras,
)
from nico_selfmodel.estimation.observations.observations import Observations
from nico_selfmodel.estimation.observations.pixel_observations import PixelObservations, seen_points
from nico_selfmodel.model.arm.dh_parameters import slopes_by_angle
from nico_selfmodel.plant import SelfModelPlant

from .simulated_bodies import Truth, blinded, body, poses, protocol


@pytest.fixture(scope="module")
def case():
    """Return a body's truth and 12 poses, some of them seen by one camera only."""
    one = body()
    data = poses(one, 12)
    data = blinded(blinded(data, [2, 5], 0), [7], 1)
    return Truth.of(one), data, PixelObservations.from_dataset(data)


def block_of(case, kind):
    truth, data, observations = case
    if kind == "points":
        block = HandPoints(Observations.from_dataset(data), truth.parameters)
        return block, truth.parameters.values
    x = np.concatenate([truth.parameters.values, truth.rig.values])
    return HandPixels(observations, truth.parameters), x


@pytest.mark.parametrize("kind", ["rows", "points"])
def test_the_derivatives_are_those_of_central_differences(case, kind):
    block, x = block_of(case, kind)
    rng = np.random.default_rng(3)
    width = block.seen.shape[1]
    w = np.tril(rng.normal(size=(len(block.seen), width, width)))
    block.whiten(w * block.seen[:, :, None] * block.seen[:, None, :])
    x = x + 1e-3 * rng.normal(size=len(x)) * np.where(np.abs(x) > 10.0, 100.0, 1.0)
    _, jacobian = block.evaluate(x)
    for i, name in enumerate(block.names):
        h = 1e-4 if np.abs(x[i]) > 10.0 else 1e-6
        step = h * (np.arange(len(x)) == i)
        numeric = (block.evaluate(x + step)[0] - block.evaluate(x - step)[0]) / (2.0 * h)
        size = max(np.abs(numeric).max(), 1e-2)
        assert jacobian[i] == pytest.approx(numeric, abs=1e-6 * size), name


@pytest.mark.parametrize("kind", ["rows", "points"])
def test_the_derivatives_by_the_joint_angles_are_those_of_moved_encoders(case, kind):
    truth, data, _ = case
    block, x = block_of(case, kind)
    slopes = block.by_angle(x)
    for j, gear in enumerate(truth.parameters.servos.gear):
        moved = []
        for sign in (-1.0, 1.0):
            unit = truth.parameters.servos.radians_per_unit[j]
            encoders = data.encoders.copy()
            encoders[:, j] += sign * 1e-6 * gear / unit
            shifted = replace(data, encoders=encoders)
            other = (truth, shifted, PixelObservations.from_dataset(shifted))
            moved.append(block_of(other, kind)[0].project(x)[0].T)
        numeric = (moved[1] - moved[0]) / 2e-6
        assert slopes[:, :, j] == pytest.approx(numeric, abs=1e-4 * np.abs(numeric).max())


def test_the_residuals_at_the_truth_are_the_noise_and_gaps_say_nothing(case):
    truth, data, observations = case
    block, x = block_of(case, "rows")
    r, jacobian = block.evaluate(x)
    hidden = ~observations.seen.T
    assert hidden.sum() == 2 * 3
    assert not r[hidden].any()
    assert not jacobian[:, hidden].any()
    # Half a degree of play in four joints is some pixels, and nobody's systematic error.
    assert 0.5 < np.sqrt(np.mean(r[~hidden] ** 2)) < 6.0
    pixels = truth.rig.project(data.p_WH_measured)
    assert np.nanstd(pixels - data.pixels) == pytest.approx(0.3, rel=0.35)


def test_projecting_to_the_cameras_is_what_the_rig_does(case):
    truth, data, _ = case
    pixels = project_to_cameras(data.p_WH_measured.T, truth.rig.values)[0]
    np.testing.assert_allclose(pixels.T, truth.rig.project(data.p_WH_measured), atol=1e-9)


def test_the_drake_plant_moves_the_hand_as_the_derivatives_say(case):
    """The plant's own Jacobian by the joint angles, in the left camera's frame."""
    truth, data, observations = case
    model = truth.model()
    robot = SelfModelPlant.from_urdf(protocol().arm, model)
    context = robot.plant.CreateDefaultContext()
    frame = robot.tracked_point_frame("hand")
    points, jacobian = observations.arm.predicted(truth.parameters)
    slopes = slopes_by_angle(truth.parameters, jacobian)
    readings = data.encoders[observations.arm.rows]
    for i in range(3):
        q = model.servos.to_joint(readings[i])
        moved = []
        for j in range(len(q)):
            ends = []
            for sign in (-1.0, 1.0):
                robot.set_joint_angles(context, q + sign * 1e-5 * (np.arange(len(q)) == j))
                own = robot.own_context(context)
                world = robot.plant.world_frame()
                ends.append(robot.plant.CalcRelativeTransform(own, world, frame).translation())
            moved.append((ends[1] - ends[0]) / 2e-5)
        robot.set_joint_angles(context, q)
        own = robot.own_context(context)
        at = robot.plant.CalcRelativeTransform(own, robot.plant.world_frame(), frame).translation()
        assert points[i] == pytest.approx(at, abs=1e-10)
        assert slopes[i] == pytest.approx(np.array(moved).T, abs=1e-8)


def test_points_are_reconstructed_where_both_cameras_saw_them(case):
    truth, data, observations = case
    seen = seen_points(observations, truth.rig, 0.3)
    assert np.isnan(seen[[2, 5, 7]]).all()
    there = np.isfinite(seen).all(axis=1)
    assert there.sum() == 9
    assert np.linalg.norm(seen - data.p_WH_measured, axis=1)[there].max() < 5e-3


def test_reflections_are_no_sightings_of_the_hand(case):
    _, data, _ = case
    some = replace(data, mirror=np.array(["glass"] * 4 + [""] * 8))
    assert PixelObservations.from_dataset(some).arm.rows.tolist() == list(range(4, 12))
    with pytest.raises(DataError, match="no pixels"):
        PixelObservations.from_dataset(replace(data, mirror=np.array(["glass"] * 12)))
