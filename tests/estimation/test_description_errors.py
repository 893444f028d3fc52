"""How far a described robot is off is told by the data, and so is what only it tells."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from nico_selfmodel.errors import DataError
from nico_selfmodel.estimation.judging import result_of
from nico_selfmodel.estimation.tree.tree_calibration import calibrate_tree
from nico_selfmodel.estimation.tree.tree_findings import described_words
from nico_selfmodel.estimation.tree.tree_priors import BEFOREHAND, expected_priors
from nico_selfmodel.estimation.tree.tree_setup import (
    DESCRIBED,
    Alike,
    Description,
    robot_sigmas_of,
)
from nico_selfmodel.model.tree.body_tree import BodyTree

from ..slow_rest import slow_rest
from .simulated_trees import one_arm, turned

NAMES = tuple(f"p{i}" for i in range(60))
TURNS, PLACES = Alike(NAMES[:25], 0.03), Alike(NAMES[25:50], 0.01)


def asked(seed, turn, place, noise=1e-3, told=slice(None)):
    """Priors that the data ask for where parts are off by so much; ten more have none."""
    rng = np.random.default_rng(seed)
    U = rng.normal(size=(200, 60)) / noise
    U[:, np.setdiff1d(np.arange(50), np.arange(50)[told])] = 0.0
    off = np.concatenate([turn * rng.normal(size=25), place * rng.normal(size=25), np.ones(10)])
    u = -U @ off + rng.normal(size=200)
    priors = {name: (0.0, group.sigma) for group in (TURNS, PLACES) for name in group.names}
    values = dict.fromkeys(NAMES, 0.0)
    found = expected_priors(priors, (TURNS, PLACES), NAMES, values, (U, u))
    assert set(found) == set(priors)
    assert len({found[name] for name in TURNS.names}) == 1
    return found[NAMES[0]][1], found[NAMES[25]][1]


def test_the_data_tell_how_far_parts_are_off():
    found = np.array([asked(seed, 0.01, 0.003) for seed in range(40)])
    assert np.sqrt(np.mean(found**2, axis=0)) == pytest.approx([0.01, 0.003], rel=0.07)
    # 25 numbers tell a standard deviation to a seventh.
    assert found.std(axis=0) / found.mean(axis=0) == pytest.approx([0.14, 0.14], abs=0.05)


def test_what_noise_hides_is_no_error_of_the_description():
    found = np.array([asked(seed, 0.002, 0.002, noise=0.02) for seed in range(40)])
    assert np.median(found, axis=0) == pytest.approx([0.002, 0.002], rel=0.5)


def test_untold_parts_are_off_by_what_a_description_is_said_to_be_off_by():
    assert asked(0, 0.01, 0.003, told=slice(0, 0)) == pytest.approx((0.03, 0.01), rel=1e-3)
    # One part that is right says that the others are nearer, by a factor of some three.
    one = np.median([asked(seed, 1e-6, 1e-6, told=slice(0, 1))[0] for seed in range(10)])
    assert one == pytest.approx(0.03 * np.exp(-0.25 / BEFOREHAND**2), rel=0.02)
    assert 0.2 < one / 0.03 < 0.4
    # Five and twenty are believed.
    assert asked(0, 1e-6, 1e-6)[0] < 1e-3


def test_parameters_without_such_priors_keep_theirs():
    rng = np.random.default_rng(1)
    U, u = rng.normal(size=(80, 60)), rng.normal(size=80)
    priors = {"p0": (0.0, 1.0), "p55": (0.2, 0.5)}
    found = expected_priors(priors, (TURNS,), NAMES, dict.fromkeys(NAMES, 0.0), (U, u))
    assert found["p55"] == (0.2, 0.5)
    assert found["p0"] != (0.0, 1.0)
    assert expected_priors(priors, (), NAMES, dict.fromkeys(NAMES, 0.0), (U, u)) == priors


@pytest.mark.parametrize("few", slow_rest([2, 1, 3, 6], plain=0))
def test_what_only_a_description_tells_is_off_as_far_as_is_claimed_be_few_parts_told(few):
    told = [asked(seed, 0.0173, 0.0058, told=slice(0, few))[0] for seed in range(200)]
    # A part that nothing tells is off by 0.0173.
    assert 0.6 < np.mean((0.0173 / np.array(told)) ** 2) < 1.3


@pytest.mark.parametrize(("each", "said"), [(9.9, True), (10.1, False)])
def test_few_told_parts_of_a_description_that_alone_tells_lengths_are_a_warning(each, said):
    places = tuple(f"j{k}.x" for k in range(20))
    left = 1e-4 * (1.0 - each / 20.0) * np.eye(20)
    problem = SimpleNamespace(priors=dict.fromkeys(places, (0.0, 0.01)))
    calibration = SimpleNamespace(
        setup=SimpleNamespace(scale_from=DESCRIBED, alike=(Alike((), 0.03), Alike(places, 0.01))),
        ladder=SimpleNamespace(solution=SimpleNamespace(problem=problem)),
        uncertainty=SimpleNamespace(names=places, covariance=left),
    )
    words = described_words(calibration)
    assert len(words) == said
    assert not said or "tells 9.9 of its 20 places" in words[0]
    calibration.setup.scale_from = "tracker"
    assert described_words(calibration) == []


def described(sim, seed, degrees, millimetres, **how):
    """The robot with its frames off, nothing known of its markers."""
    rng = np.random.default_rng(seed)
    X_PJ = np.stack([X @ turned(rng, degrees, millimetres) for X in sim.tree.X_PJ])
    markers = tuple(replace(marker, X_LA=np.eye(4)) for marker in sim.tree.markers)
    tree: BodyTree = replace(sim.tree, X_PJ=X_PJ, markers=markers)
    return Description(tree, **how)


@pytest.mark.slow
def test_a_body_says_how_far_its_description_is_off():
    off = []
    for seed in range(6):
        sim = one_arm(seed, joints=6, markers=3, poses=40)
        found = calibrate_tree(sim.data, description=described(sim, seed, 1.0, 4.0), effects=())
        said = result_of(found).details["description_off"]
        assert said["learned"]
        off.append([said["turn_sigma_deg"], said["shift_sigma_mm"]])
    expected = np.array([1.0, 4.0]) / np.sqrt(3.0)  # of each part
    assert np.mean(off, axis=0) == pytest.approx(expected, rel=0.25)


def test_what_the_user_states_stays():
    sim = one_arm(1, joints=4, markers=3, poses=20)
    stated = described(sim, 1, 1.0, 4.0, turn_sigma=0.02, shift_sigma=0.007, learned=False)
    found = calibrate_tree(sim.data, description=stated, effects=())
    said = result_of(found).details["description_off"]
    assert said == {
        "turn_sigma_deg": pytest.approx(np.degrees(0.02)),
        "shift_sigma_mm": pytest.approx(7.0),
        "learned": False,
    }
    assert found.ladder.solution.problem.priors["j2.x"] == (0.0, 0.007)


@pytest.mark.slow
def test_a_joint_that_moves_the_other_way_than_described_is_named():
    sim = one_arm(4, joints=4, markers=3, poses=30)
    robot = described(sim, 4, 1.0, 4.0)
    readings = np.array(sim.data.readings)
    readings[:, 2] *= -1.0
    with pytest.raises(DataError, match="'j3' moves the other way than described"):
        calibrate_tree(replace(sim.data, readings=readings), description=robot, effects=())


@pytest.mark.parametrize("word", ["2", "2,x", "0,1", "1,-1", "", "1,2,3", "nan,1"])
def test_how_far_a_robot_may_be_off_is_two_positive_numbers(word):
    with pytest.raises(ValueError, match="--robot-sigma"):
        robot_sigmas_of(word)
    assert robot_sigmas_of("2,10") == pytest.approx((np.radians(2.0), 0.01))
