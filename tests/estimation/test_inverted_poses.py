"""Poses of a flange, or of what a sensor saw, that are told the other way round."""

from dataclasses import replace

import numpy as np
import pytest

from nico_selfmodel.errors import DataError
from nico_selfmodel.estimation.judging import judge
from nico_selfmodel.estimation.tree.guesses.flange_guess import CARRIED_NEARER, either_way
from nico_selfmodel.estimation.tree.tree_calibration import calibrate_tree
from nico_selfmodel.geometry.rotation import rotation_from_vector, rotation_vectors_of
from nico_selfmodel.geometry.transform import inverse, transform

from .test_hand_eye_by_corners import recorded
from .test_one_problem import flange_dataset, hand_eye_poses

OF_FLANGE = r"invert poses of the flange, which seem to tell the base in it \('target' is then"
OF_SENSOR = (
    "invert the poses that 'camera' tells of 'target', or exchange 'on' of both, if 'camera' is on "
    "the flange and 'target' stands"
)


def poses(seed, near=0.1, far=0.7):
    """Poses of a flange that carries a target so far off, of a sensor so far from its base."""
    X, Z, F, M = hand_eye_poses(np.random.default_rng(seed), 20)
    noise = inverse(X) @ inverse(F) @ Z @ M
    X[:3, 3] *= near / np.linalg.norm(X[:3, 3])
    Z[:3, 3] *= far / np.linalg.norm(Z[:3, 3])
    return F, inverse(Z) @ F @ X @ noise


@pytest.mark.parametrize("seed", range(4))
def test_which_side_of_a_hand_eye_calibration_is_inverted_is_told(seed):
    F, M = poses(seed)
    for told, words in (((inverse(F), M), OF_FLANGE), ((F, inverse(M)), OF_SENSOR)):
        with pytest.raises(DataError, match=f"the other way round: {words}"):
            calibrate_tree(flange_dataset(*told))


def test_both_sides_inverted_fit_and_are_doubted_where_the_hand_would_carry_what_stands():
    F, M = poses(1)
    said = [
        judge(calibrate_tree(flange_dataset(*told))).warnings
        for told in ((F, M), (inverse(F), inverse(M)))
    ]
    doubts = [[words for words in one if "inverted" in words] for one in said]
    assert doubts[0] == []
    words = "'target' would be 700 mm from 'tcp' that carries it, 'camera' 100 mm from its base"
    assert doubts[1][0].startswith(words)


@pytest.mark.parametrize(
    ("ratio", "flange", "sensor"), [(0.95, True, True), (1.05, True, False), (1 / 4.2, False, True)]
)
def test_both_sides_are_named_where_nothing_tells_which_is_carried(ratio, flange, sensor):
    F, M = poses(2, near=0.1, far=0.1 * CARRIED_NEARER * ratio)
    with pytest.raises(DataError) as caught:
        calibrate_tree(flange_dataset(inverse(F), M))
    assert ("invert poses of the flange" in str(caught.value)) == flange
    assert ("invert the poses that 'camera' tells" in str(caught.value)) == sensor


@pytest.mark.parametrize(("noise", "refused"), [(0.05, True), (0.5, False)])
def test_poses_that_fit_neither_way_are_not_called_inverted(noise, refused):
    F, M = poses(3)
    rng = np.random.default_rng(3)
    F = F @ transform(rotation_from_vector(noise * rng.normal(size=(20, 3))), np.zeros(3))
    words = ("tcp", "camera", "target")
    if refused:
        with pytest.raises(DataError, match="the other way round"):
            either_way(inverse(F), M, words, carried=False)
    else:
        either_way(inverse(F), M, words, carried=False)


def test_a_flange_that_is_inverted_before_corners_is_told():
    _, data = recorded(np.random.default_rng(0))
    F = inverse(data.X_flange[:, 0])
    told = np.hstack([F[:, :3, 3], rotation_vectors_of(F[:, :3, :3])])[:, None]
    with pytest.raises(DataError, match=r"invert poses of the flange, .*'camera' is then"):
        calibrate_tree(replace(data, flanges=told))
