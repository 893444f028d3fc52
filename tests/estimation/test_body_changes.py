"""What changed in a sharp body, however little or much, is named; somewhat louder noise is none."""

from dataclasses import replace

import numpy as np
import pytest

from nico_selfmodel.errors import DataError
from nico_selfmodel.estimation.monitoring.body_causes import body_causes, body_changes
from nico_selfmodel.estimation.monitoring.body_health import check_body_health, white_poses
from nico_selfmodel.estimation.monitoring.body_relearning import relearn_body
from nico_selfmodel.estimation.monitoring.health_document import health_document
from nico_selfmodel.estimation.monitoring.misfit import LOUDER, Misfit
from nico_selfmodel.estimation.monitoring.monitored_changes import (
    ANYTHING,
    SHIFTS,
    MonitoredChanges,
)
from nico_selfmodel.estimation.noise.mixture_density import MixtureDensity
from nico_selfmodel.estimation.noise.pose_residuals import PoseResiduals
from nico_selfmodel.estimation.results.fixed_parameters import FixedParameters
from nico_selfmodel.estimation.tree.tree_calibration import calibrate_tree
from nico_selfmodel.estimation.tree.tree_errors import told_as
from nico_selfmodel.estimation.tree.tree_parameters import TreeParameters
from nico_selfmodel.estimation.tree.tree_result import body_model
from nico_selfmodel.estimation.tree.tree_setup import Wishes
from nico_selfmodel.geometry.rotation import rotation_from_vector
from nico_selfmodel.geometry.transform import inverse, transform
from nico_selfmodel.model.cameras.camera import Camera
from nico_selfmodel.model.noise_mixture import NoiseMixture

from ..slow_rest import slow_rest
from .simulated_trees import observed, one_arm

JOINT_SIGMA, SIGMA = np.radians(0.05), {"points": 2e-4, "turn": 2e-3}


@pytest.fixture(scope="module")
def arm():
    """An arm of five joints before a tracker, and what it has learned of itself."""
    sim = one_arm(5, joints=5, markers=3, poses=60, joint_sigma=JOINT_SIGMA)
    return sim, body_model(calibrate_tree(sim.data, effects=()))


def day(sim, seed, change=lambda tree, q: (tree, q), *, poses=30, louder=1.0):
    """Another recording, of a body that changed; how it stands beside what its encoders say."""
    rng = np.random.default_rng((seed, 9))
    q = rng.uniform(-1.0, 1.0, (poses, 5))
    tree, stood = change(sim.tree, q)
    sigma = {kind: louder * value for kind, value in SIGMA.items()}
    data = observed(
        tree, sim.data.joints, sim.data.markers, sim.data.sensors, stood, rng,
        joint_sigma=louder * JOINT_SIGMA, sigma=sigma,
    )  # fmt: skip
    return replace(data, readings=q)


def slipped(joint, degrees):
    def change(tree, q):
        return tree, q + np.radians(degrees) * (np.arange(5) == joint)

    return change


def geared(tree, q):
    return tree, q * np.where(np.arange(5) == 1, 1.01, 1.0)


def tracker_moved(tree, q):
    X = transform(rotation_from_vector([0.0, 0.005, 0.005]), [0.004, 0.0, 0.003])
    return replace(tree, sensors=(replace(tree.sensors[0], X_LA=X),)), q


@pytest.mark.parametrize(
    ("change", "cause"),
    slow_rest(
        [
            (slipped(2, 0.6), "zero of j3"),
            (slipped(2, 12.0), "zero of j3"),
            (slipped(1, 60.0), "zero of j2"),
            (slipped(1, 180.0), "zero of j2"),
            (geared, "gear of j2"),
        ],
        plain=3,
    ),
)
def test_a_change_of_any_size_is_laid_to_what_changed(arm, change, cause):
    sim, model = arm
    report = check_body_health(model, day(sim, 1, change))
    assert report.alarm_at is not None
    assert report.diagnoses[0].hypothesis.cause == cause


@pytest.mark.parametrize("louder", [1.0, 1.4])
def test_a_body_that_is_as_it_was_is_healthy_be_its_noise_louder(arm, louder):
    sim, model = arm
    reports = [check_body_health(model, day(sim, k, louder=louder)) for k in range(12)]
    assert sum(report.healthy for report in reports) >= 11


def test_what_no_distance_tells_apart_is_told_to_be_either(arm):
    """A tracker that was moved has the same to show as an arm that was: its first joint's frame."""
    sim, model = arm
    report = check_body_health(model, day(sim, 3, tracker_moved))
    reason = health_document(report)["reasons"][0]
    assert "sensor tracker on its link" in reason
    assert "j1 on what carries it" in reason
    assert "nothing tells them apart" in reason


def test_two_changes_are_not_explained_by_one_that_is_learned_anew(arm):
    """Were noise estimated anew, it would take the other one up."""
    sim, model = arm

    def both(tree, q):
        return tree, q + np.radians(1.5) * np.isin(np.arange(5), (1, 3))

    data = day(sim, 4, both)
    report = check_body_health(model, data)
    assert not relearn_body(model, data, report).fits
    one = day(sim, 4, slipped(1, 1.5))
    assert relearn_body(model, one, check_body_health(model, one)).fits


def test_markers_that_move_together_are_looked_for_as_they_shift(arm):
    _, model = arm
    names = TreeParameters(model.tree).names
    causes = body_causes(model.tree, names)
    (together,) = (one for one in causes if one.cause == "all markers on j5 together")
    places = [names.index(f"{m.name}.{axis}") for m in model.tree.markers for axis in "xyz"]
    shifts = body_changes(model.tree, (together,)).basis[places].reshape(3, 3, -1)
    assert np.ptp(shifts, axis=0) == pytest.approx(0.0)  # all markers by the same
    assert set(np.round(np.linalg.norm(shifts[0], axis=0), 9)) == set(SHIFTS)


@pytest.mark.parametrize(("louder", "fails"), [(0.99, False), (1.01, True)])
def test_what_all_poses_are_off_by_is_bounded_by_louder_noise(louder, fails):
    n = 10000
    most = LOUDER**2 * (1.0 + 4.0 * np.sqrt(6.0 / n))
    assert Misfit(louder * most * n, n).too_large == fails
    assert not Misfit(0.0, 0).too_large


NOISE = NoiseMixture(1.0, 0.01, 3.0, 0.03, 0.0, 0.005, 60)


def seen_poses(residuals, slopes):
    """Poses of two parameters whose noise is 1 in each of three coordinates."""
    none, seen = np.zeros((200, 3, 0)), np.ones((200, 3), dtype=bool)
    return PoseResiduals("points", ("a", "b"), residuals, none, none, slopes, seen, np.arange(200))


def test_changes_that_are_plain_to_see_are_looked_for_in_smaller_sizes_too():
    """Where they move poses by twelve standard deviations or more: then by six."""
    slopes = np.zeros((200, 3, 2))
    slopes[:, 0, 0] = slopes[:, 1, 1] = 1.0
    density = MixtureDensity(seen_poses(np.zeros((200, 3)), slopes), NOISE)
    sizes, weights = np.diag([11.9, 12.1]), np.array([0.3, 0.5, *[0.2 / ANYTHING] * ANYTHING])
    found = MonitoredChanges(sizes, weights).with_plain_sizes(density, slopes)
    assert found.basis == pytest.approx(np.array([[11.9, 0.0, 0.0], [0.0, 12.1, 6.0]]))
    assert found.weights[:3] == pytest.approx([0.3, 0.25, 0.25])
    assert found.weights[3:] == pytest.approx(weights[2:])


def test_errors_of_the_body_itself_count_once():
    """A body that is hardly known may be off by much, alike in all poses."""
    rng = np.random.default_rng(8)
    slopes = rng.normal(size=(200, 3, 2))
    poses = seen_poses(slopes @ [0.0, 5.0] + rng.normal(size=(200, 3)), slopes)
    known, vague = (Misfit.of(poses, NOISE, np.diag([0.01, v])) for v in (1e-6, 25.0))
    assert known.per_coordinate > 10.0
    assert vague.per_coordinate == pytest.approx(1.0, abs=4.0 * np.sqrt(2.0 / 600))
    assert Misfit.of(poses.select(slice(0)), NOISE, np.eye(2)).n == 0


def test_detections_of_a_pose_are_counted_one_by_one(arm):
    """A detection has three coordinates; of the first pose two markers are left out."""
    sim, model = arm
    data = day(sim, 11, poses=20)
    table = data.observations
    found = white_poses(model, data.of_rows((table.pose > 0) | (table.marker == 0)))
    assert found is not None
    assert found[1].tolist() == [1] + [3] * 19


@pytest.mark.parametrize(
    ("kind", "edit", "said"),
    [
        ("markers", {"on": "j4"}, "marker 'hand_tag0' is on j4 in data set .*, on j5 in the body"),
        ("joints", {"parent": "j1"}, "joint 'j3' is carried by j1 in data set .* j2 in the body"),
        (
            "joints",
            {"motion": "prismatic", "encoder_unit": "m"},
            "joint 'j3' is prismatic in data set .*, revolute in",
        ),
        ("sensors", {"on": "j1"}, "sensor 'tracker' is on j1 in data set .*, on world in the body"),
        ("joints", {"follows": {"j1": 0.5}}, "joint 'j3' follows others otherwise in data set"),
    ],
)
def test_a_recording_that_says_otherwise_what_carries_what_is_of_another_body(
    arm, kind, edit, said
):
    sim, model = arm
    items = list(getattr(sim.data, kind))
    i = 2 if kind == "joints" else 0
    items[i] = replace(items[i], **edit)
    with pytest.raises(DataError, match=said):
        told_as(model.tree, replace(sim.data, **{kind: tuple(items)}))
    told_as(model.tree, sim.data)


def test_a_zoom_that_was_turned_is_no_camera_that_moved():
    sim = one_arm(4, joints=5, markers=3, poses=60, sensor="camera", joint_sigma=JOINT_SIGMA)
    left, right = (sensor.X_LA for sensor in sim.tree.sensors)
    pins = FixedParameters({"right.x": float((inverse(left) @ right)[0, 3])})
    body = body_model(calibrate_tree(sim.data, wishes=Wishes(pins), effects=()))
    values = dict(sim.tree.lenses["left"].named_values)
    values |= {"fx": 1.05 * values["fx"], "fy": 1.05 * values["fy"]}
    zoomed = Camera.from_values(np.array(list(values.values())), sim.tree.lenses["left"].image_size)
    tree = replace(sim.tree, lenses={**sim.tree.lenses, "left": zoomed})
    rng = np.random.default_rng(17)
    q = rng.uniform(-1.0, 1.0, (30, 5))
    data = observed(
        tree, sim.data.joints, sim.data.markers, sim.data.sensors, q, rng,
        joint_sigma=JOINT_SIGMA, sigma={"camera": 0.3},
    )  # fmt: skip
    data = replace(data, readings=q)
    report = check_body_health(body, data)
    assert report.diagnoses[0].hypothesis.cause == "focal length of camera left"
    learned = relearn_body(body, data, report).model.tree.lenses["left"].named_values
    assert learned["fx"] == pytest.approx(values["fx"], rel=3e-3)
    assert learned["cx"] == pytest.approx(values["cx"], abs=1e-9)
