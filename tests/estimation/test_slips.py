"""Which joint was read wrongly in which poses: one pose by itself, and all of them together."""

from types import SimpleNamespace

import numpy as np
import pytest

from nico_selfmodel.estimation.judging import judge
from nico_selfmodel.estimation.noise import joint_slips
from nico_selfmodel.estimation.noise.joint_slips import FEWEST_SLIPS, slipped_joints
from nico_selfmodel.estimation.noise.pose_noise import PoseGroups, PoseNoise, PoseWhitening
from nico_selfmodel.estimation.tree.tree_calibration import calibrate_tree

from ..slow_rest import slow_rest
from .simulated_trees import one_arm

VISITS, JOINTS, FREE = 100, 5, 6
SENSOR, JOINT = 1.0, 2.0


def seen(seed, share=0.0, size=0.0, noise=1.0, shown=1.0):
    """One point a visit, moved by five joints of which the third slips; residuals after a fit.

    The third joint shows in a share of the visits alone, as that of a second arm.
    """
    rng = np.random.default_rng(seed)
    A = rng.normal(size=(VISITS, 3, JOINTS))
    A[np.arange(VISITS) >= shown * VISITS, :, 2] = 0.0
    off = JOINT * rng.normal(size=(VISITS, JOINTS))
    slips = rng.random(VISITS) < share
    off[slips, 2] += size * JOINT * rng.choice([-1.0, 1.0], int(slips.sum()))
    r = np.einsum("vkj,vj->vk", A, off) + SENSOR * rng.normal(size=(VISITS, 3))
    J = rng.normal(size=(VISITS, 3, FREE))
    groups = PoseGroups(np.repeat(np.arange(VISITS), 3), np.ones(3 * VISITS, dtype=bool), 1)
    by_joint, J = A.reshape(-1, 1, JOINTS), J.reshape(-1, FREE)
    whitening = PoseWhitening(groups, by_joint, PoseNoise(SENSOR, np.full(JOINTS, noise * JOINT)))
    found = slipped_joints(whitening, r.ravel(), J, np.zeros(FREE))
    return found.slipped, found.part, slips


def test_one_large_slip_is_found_in_its_pose():
    found, part, slips = seen(9, share=0.01, size=25.0)
    assert 1 <= slips.sum() < FEWEST_SLIPS
    assert part is None
    assert found[slips, 2].all()
    assert found[~slips].sum() <= 1


def test_noise_that_is_far_too_large_finds_nothing_and_warns_of_nothing():
    rng = np.random.default_rng(0)
    visits, rows = 30, 40
    groups = PoseGroups(np.repeat(np.arange(visits), rows), np.ones(visits * rows, bool), 1)
    A, J = (rng.normal(size=(visits * rows, k)) for k in (JOINTS, FREE))
    noise = PoseNoise(1.0, np.full(JOINTS, 1e7))
    whitening = PoseWhitening(groups, A[:, None], noise)
    found = slipped_joints(whitening, rng.normal(size=visits * rows), J, np.zeros(FREE))
    assert not found.slipped.any()


def test_where_fewer_joints_slip_at_one_noise_they_may_be_the_likeliest():
    def scores(*likelihoods):
        none = np.zeros((20, 3), dtype=bool)
        tries = []
        for count, likelihood in enumerate(likelihoods, start=1):
            slipped = none.copy()
            slipped[:, :count] = True
            tries.append(joint_slips._Often(likelihood, slipped, None))
        return SimpleNamespace(often_slipped=lambda: tries, likelihood=0.0)

    found, _ = joint_slips._likeliest([scores(10.0, 50.0, 60.0), scores(100.0), scores(5.0)])
    assert found.likelihood == 100.0
    assert found.slipped.any(axis=0).sum() == 1


@pytest.mark.slow
def test_many_small_slips_are_found_together():
    named, hit, alarms = 0, [], []
    for seed in range(10):
        found, part, slips = seen(seed, share=0.15, size=7.0)
        counts = found.sum(axis=0)
        named += int(np.argmax(counts)) == 2 and counts[2] >= 5
        hit.append(found[slips, 2].mean())
        alarms.append(found[~slips].mean())
        assert part is None or 0.7 < part < 1.3
    assert named == 10
    assert np.mean(hit) > 0.6
    assert np.mean(alarms) < 0.02


@pytest.mark.slow
def test_a_joint_that_few_visits_show_is_found_to_slip_as_well():
    named = 0
    for seed in range(6):
        found, _, slips = seen(seed, share=0.3, size=12.0, shown=0.35)
        assert not found[35:, 2].any()
        counts = found.sum(axis=0)
        named += int(np.argmax(counts)) == 2 and found[:35][slips[:35], 2].mean() > 0.6
    assert named >= 5


@pytest.mark.slow
def test_slips_that_were_taken_for_noise_are_still_found():
    parts = [seen(seed, share=0.15, size=7.0, noise=1.5)[1] for seed in range(10)]
    assert sum(part is not None for part in parts) >= 8
    assert np.median([part for part in parts if part is not None]) == pytest.approx(0.67, abs=0.1)


@pytest.mark.slow
def test_without_slips_no_joint_slips_often():
    for seed in range(60):
        found, part, _ = seen(seed)
        assert part is None
        assert found.sum() <= 2


@pytest.mark.slow
def test_a_joint_that_jumps_is_named_by_one_marker_alone():
    for seed in (8006, 8013, 8038):  # noise had hidden them all
        rng = np.random.default_rng((77, seed))
        joints, poses = int(rng.integers(4, 8)), int(rng.integers(40, 121))
        j = int(rng.integers(0, joints))
        slip = (j, 0.12, np.radians(1.2))
        sim = one_arm(seed, joints=joints, markers=1, poses=poses, slip=slip)
        found = calibrate_tree(sim.data, effects=(), seed=seed)
        words = [w for w in judge(found).warnings if "the encoder of" in w]
        assert len(words) == 1
        assert f"'j{j + 1}'" in words[0]
        assert np.degrees(found.solution.noise.joint.mean()) == pytest.approx(0.2, rel=0.15)


QUIET = np.radians(0.02)
BEHIND = [
    *[("points", 3, 9402, 10.0), ("points", 1, 9400, 30.0), ("camera", 4, 9105, 1.2)],
    *[("points", 1, 9105, 1.2), ("points", 3, 9107, 1.2), ("points", 3, 9103, 1.2)],
    *[("points", 3, 9401, 30.0), ("camera", 4, 9402, 30.0), ("points", 1, 9402, 10.0)],
]


@pytest.mark.slow
@pytest.mark.parametrize(("sensor", "markers", "seed", "degrees"), slow_rest(BEHIND))
def test_a_joint_that_jumps_far_is_not_taken_for_markers_that_are_wrong(
    sensor, markers, seed, degrees
):
    # Sixty times joint noise and more: all that the joint carries had been set aside at the start.
    rng = np.random.default_rng((77, seed))
    joints = int(rng.integers(5, 8))
    j = int(rng.integers(1, joints - 1))
    sim = one_arm(
        seed,
        joints=joints,
        markers=markers,
        sensor=sensor,
        slip=(j, 0.12, np.radians(degrees)),
        joint_sigma=np.full(joints, QUIET),
    )
    found = calibrate_tree(sim.data, effects=(), seed=seed)
    words = [w for w in judge(found).warnings if "the encoder of" in w]
    assert len(words) == 1
    assert f"'j{j + 1}'" in words[0]
    assert not found.solution.outliers.any()
    # What is not linear in a jump is no noise of the joints.
    assert np.degrees(found.solution.noise.joint.mean()) < 0.07
