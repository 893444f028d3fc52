from dataclasses import replace

import numpy as np
import pytest

from nico_selfmodel.dataset.dataset import Dataset
from nico_selfmodel.dataset.folder import load_dataset
from nico_selfmodel.dataset.joint_info import JointInfo
from nico_selfmodel.dataset.sweeps import find_sweeps, marked_sweeps, unmarked_sweeps


def by_joint(sweeps):
    """Return the sets of rows of each joint's sweeps."""
    found = {}
    for sweep in sweeps:
        found.setdefault(sweep.joint, []).append(set(sweep.rows.tolist()))
    return found


def grid(rows, columns):
    """Return the poses of a grid of two joints, in a fixed disorder."""
    poses = np.stack(np.meshgrid(np.arange(rows), np.arange(columns), indexing="ij"), -1)
    return np.random.default_rng(0).permutation(poses.reshape(-1, 2).astype(float))


def star(joint_count, steps, step):
    """Return a home pose (row 0) and a sweep of each joint from it."""
    home = np.linspace(10.0, 20.0, joint_count)
    poses = [home]
    for joint in range(joint_count):
        for k in range(1, steps + 1):
            pose = home.copy()
            pose[joint] += step * k
            poses.append(pose)
    return np.array(poses)


def test_every_row_and_column_of_a_grid_is_a_sweep():
    poses = grid(5, 7)
    found = by_joint(find_sweeps(poses))
    for joint, count in ((0, 7), (1, 5)):
        levels = [set(np.flatnonzero(poses[:, 1 - joint] == k)) for k in range(count)]
        assert sorted(map(sorted, found[joint])) == sorted(map(sorted, levels))


def test_sweeps_that_share_their_home_pose_all_contain_it():
    found = by_joint(find_sweeps(star(7, 3, 5.0)))
    for joint in range(7):
        assert found[joint] == [{0, *range(3 * joint + 1, 3 * joint + 4)}]


@pytest.mark.parametrize("shift", np.linspace(0.0, 1.0, 7))
def test_noise_within_the_tolerance_parts_no_sweep_wherever_a_raster_would_cut(shift):
    noise = np.random.default_rng(5).uniform(-1.0, 1.0, (35, 2))
    found = by_joint(find_sweeps(grid(5, 7) + 0.0099 * noise + 0.01 * shift, tolerance=0.01))
    assert len(found[0]) == 7
    assert len(found[1]) == 5
    assert sum(map(len, found[0])) == sum(map(len, found[1])) == 35


def test_a_slow_motion_does_not_pass_for_a_joint_that_holds_still():
    poses = star(3, 400, 0.01)
    found = by_joint(find_sweeps(poses, tolerance=0.1))
    for joint in range(3):
        own = set(range(400 * joint + 1, 400 * joint + 401))
        largest = max(found[joint], key=len)
        assert own <= largest
        held = np.delete(poses[sorted(largest)], joint, axis=1)
        assert np.ptp(held, axis=0).max() <= 0.2


def test_free_poses_hold_no_sweep():
    poses = np.random.default_rng(1).uniform(-1.0, 1.0, (1000, 4))
    assert find_sweeps(poses) == []


def test_sweeps_are_found_among_free_poses():
    free = np.random.default_rng(2).uniform(0.0, 40.0, (900, 6))
    found = by_joint(find_sweeps(np.vstack([star(6, 8, 2.0), free])))
    assert {joint: len(sweeps) for joint, sweeps in found.items()} == dict.fromkeys(range(6), 1)
    assert all(len(sweep) == 9 for (sweep,) in found.values())


def test_two_values_make_no_circle():
    assert by_joint(find_sweeps(grid(2, 3))).keys() == {1}


def test_rows_ascend_with_the_joint_that_turns_and_cannot_be_changed():
    poses = np.array([[3.0], [1.0], [2.0], [9.0]])
    (sweep,) = find_sweeps(poses)
    assert sweep.rows.tolist() == [1, 2, 0, 3]
    with pytest.raises(ValueError, match="read-only"):
        sweep.rows[0] = 0


@pytest.mark.parametrize(
    ("encoders", "tolerance", "message"),
    [
        (np.zeros(3), None, r"must be finite and have shape \(N, n\), got \(3,\)"),
        (np.full((3, 2), np.nan), None, "must be finite"),
        (np.zeros((3, 2)), -1.0, "tolerance must not be negative"),
    ],
)
def test_arguments_that_make_no_sense_are_refused(encoders, tolerance, message):
    with pytest.raises(ValueError, match=message):
        find_sweeps(encoders, tolerance)


def test_marked_sweeps_share_the_home_pose_and_leave_out_what_was_not_measured(dataset):
    sweeps = marked_sweeps(dataset)
    assert [sweep.joint for sweep in sweeps] == [0, 1]
    assert [sweep.rows.tolist() for sweep in sweeps] == [[0, 2, 4], [0, 6, 8]]
    assert [sweep.rows.tolist() for sweep in marked_sweeps(dataset, "finger")] == [
        [1, 3],
        [1, 7, 9],
    ]
    with pytest.raises(ValueError, match="marker must be one of wrist, finger, got 'toe'"):
        marked_sweeps(dataset, "toe")


def test_unmarked_sweeps_are_those_that_somebody_could_have_marked(dataset):
    assert by_joint(unmarked_sweeps(dataset)) == {0: [{0, 2, 4}], 1: [{0, 6, 8}]}
    assert unmarked_sweeps(replace(dataset, p_WH_measured=np.full((18, 3), np.nan))) == []
    # Without one hidden point the finger's shoulder sweep has two values: no circle.
    assert by_joint(unmarked_sweeps(dataset, "finger")) == {1: [{1, 7, 9}]}


def test_a_locked_joint_that_flickers_by_a_count_holds_still():
    flicker = np.random.default_rng(4).integers(0, 2, 20)
    encoders = np.column_stack([100 * np.arange(20), flicker])
    joints = [JointInfo(name, "counts", 4096) for name in ("free", "locked")]
    dataset = Dataset("d", joints, np.arange(20), encoders, np.zeros((20, 3)))
    assert by_joint(unmarked_sweeps(dataset)) == {0: [set(range(20))]}


def test_the_grid_of_a_real_positioner_is_found(project_root):
    dataset = load_dataset(project_root / "examples" / "data" / "positioner_two_axis")
    found = by_joint(unmarked_sweeps(dataset))
    assert {joint: len(sweeps) for joint, sweeps in found.items()} == {0: 16, 1: 13}
    for sweeps in found.values():
        assert sorted(row for sweep in sweeps for row in sweep) == list(range(205))
