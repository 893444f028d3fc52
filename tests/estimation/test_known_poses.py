"""Cameras that stand where somebody has measured them: their distance tells lengths."""

from dataclasses import replace

import numpy as np
import pytest

from nico_selfmodel.dataset.body.body_folder import load_body_dataset, save_body_dataset
from nico_selfmodel.dataset.body.conversion import body_dataset_of, with_poses_of
from nico_selfmodel.errors import DataError
from nico_selfmodel.estimation.judging import judge
from nico_selfmodel.estimation.results.fixed_parameters import FixedParameters
from nico_selfmodel.estimation.tree.known.known_poses import with_known_poses
from nico_selfmodel.estimation.tree.tree_calibration import calibrate_tree
from nico_selfmodel.estimation.tree.tree_result import body_model
from nico_selfmodel.estimation.tree.tree_setup import Wishes
from nico_selfmodel.geometry.rotation import rotation_from_vector
from nico_selfmodel.geometry.transform import transform
from nico_selfmodel.model.self_model import ParameterCovariance, SelfModel

from .simulated_bodies import CLEAN, Truth, body, only_cameras, poses, scenario

POSE = [f"right.pose.{part}" for part in ("rx", "ry", "rz", "x", "y", "z")]


@pytest.fixture(scope="module")
def truth():
    return Truth.of(body(0, world=CLEAN)).model()


@pytest.fixture(scope="module")
def recorded(truth):
    """Return what both cameras saw of 60 poses, their lenses known."""
    data = only_cameras(scenario(0, world=CLEAN).train)
    free = np.flatnonzero(data.sweep == "")[:60]
    return body_dataset_of(data.select(free), truth.cameras)


def cameras_of(truth, sigma=None):
    """Return the true cameras, which say what their pose is uncertain by where that is given."""
    known = None
    if sigma is not None:
        known = ParameterCovariance(tuple(POSE), np.diag(np.repeat(sigma, 3)) ** 2)
    return SelfModel("pair", cameras=truth.cameras, covariance=known)


@pytest.mark.slow
@pytest.mark.parametrize("sigma", [None, (1e-3, 1e-3)])
def test_how_cameras_stand_to_each_other_tells_lengths(recorded, truth, sigma):
    blind = calibrate_tree(recorded, effects=())
    assert any("nothing in the data tells lengths" in r for r in judge(blind).reasons)
    told = with_poses_of(recorded, cameras_of(truth, sigma))
    found = calibrate_tree(told, effects=())
    verdict = judge(found)
    assert verdict.status == "NOT_EVALUATED", verdict.reasons
    right = next(s for s in found.tree.sensors if s.name == "right")
    largest = 1e-9 if sigma is None else 3e-3
    np.testing.assert_allclose(right.X_LA, truth.rig.X_LR, atol=largest)
    assert body_model(found).covariance is not None


@pytest.mark.slow
def test_a_camera_that_was_turned_since_is_named(recorded, truth):
    (left, right), turn = truth.cameras.values(), rotation_from_vector(np.array([0.0, 0.02, 0.0]))
    turned = right.at(right.X_WC @ transform(turn, np.zeros(3)))
    pair = SelfModel("pair", cameras={"left": left, "right": turned})
    with pytest.raises(DataError, match="leave out the known `pose` of right"):
        calibrate_tree(with_poses_of(recorded, pair), effects=())


def test_known_poses_come_back_from_the_folder(recorded, truth, tmp_path):
    told = with_poses_of(recorded, cameras_of(truth, (2e-3, 1e-3)))
    assert [s.pose_sigma for s in told.sensors] == [None, (1e-3, 2e-3)]
    save_body_dataset(told, tmp_path / "told")
    again = load_body_dataset(tmp_path / "told")
    np.testing.assert_allclose(again.sensors[1].X_LS, truth.rig.X_LR, atol=1e-12)
    assert again.sensors[1].pose_sigma == (1e-3, 2e-3)
    assert again.sensors[0].pose_sigma is None


def test_a_known_pose_is_held_or_a_prior_and_what_the_user_says_counts(recorded, truth):
    exact = with_known_poses(with_poses_of(recorded, cameras_of(truth)), None, Wishes())
    parts = {f"right.{part}" for part in ("rx", "ry", "rz", "x", "y", "z")}
    assert set(exact.pins.pinned) == parts
    assert not exact.priors
    unsure = with_poses_of(recorded, cameras_of(truth, (1e-3, 2e-3)))
    own = Wishes(FixedParameters(freed=frozenset({"right.x"})), {"right.y": (0.0, 1.0)})
    wishes = with_known_poses(unsure, None, own)
    assert wishes.priors.keys() == parts - {"right.x"}
    assert wishes.priors["right.y"] == (0.0, 1.0)
    assert wishes.priors["right.rx"][1] == 1e-3
    assert not wishes.pins.pinned


def test_where_cameras_stand_says_nothing_beside_another_world(recorded, truth):
    pair = cameras_of(truth)
    tracked = body_dataset_of(poses(body(0, world=CLEAN), 10), truth.cameras)
    assert tracked.sensors[0].name == "tracker"
    assert with_poses_of(tracked, pair) is tracked
    one = SelfModel("pair", cameras={"left": truth.cameras["left"]})
    assert with_poses_of(recorded, one).sensors == recorded.sensors
    guessed = replace(recorded.sensors[1], X_LS=np.eye(4))
    stated = replace(recorded, sensors=(recorded.sensors[0], guessed))
    assert with_poses_of(stated, pair).sensors[1].pose_sigma is None


def test_half_of_what_a_pose_is_uncertain_by_is_refused(recorded, truth, tmp_path):
    save_body_dataset(with_poses_of(recorded, cameras_of(truth)), tmp_path / "told")
    head = tmp_path / "told" / "dataset.yaml"
    text = head.read_text()
    assert "sigma_rad: 0.0" in text
    head.write_text(text.replace("    sigma_rad: 0.0\n", ""))
    with pytest.raises(DataError, match="has sigma_m and sigma_rad"):
        load_body_dataset(tmp_path / "told")
