import re
from dataclasses import replace

import numpy as np
import pytest

from nico_selfmodel.dataset.dataset import Dataset
from nico_selfmodel.dataset.joint_info import JointInfo
from nico_selfmodel.errors import DataError


def free_poses(count, joints, **columns):
    """Return measured poses that belong to no sweep."""
    encoders = np.arange(2.0 * count).reshape(count, 2) ** 1.5
    columns = {"p_WH_measured": encoders[:, [0, 1, 0]] * 1e-3, **columns}
    return Dataset("free", joints, np.arange(count), encoders, **columns)


def test_arrays_are_read_only_copies(joints):
    encoders = np.zeros((2, 2))
    dataset = Dataset("d", joints, np.array([1, 2]), encoders)
    encoders[0, 0] = 9.0
    assert dataset.encoders[0, 0] == 0.0
    for array in (dataset.sample, dataset.encoders, dataset.sweep, dataset.p_WH_measured):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = array[1]


def test_what_is_not_given_is_not_measured(joints):
    dataset = Dataset("d", joints, np.array([4, 9]), np.zeros((2, 2)))
    assert not dataset.measured.any()
    assert np.isnan(dataset.pixels).all()
    assert dataset.markers == ("hand",)
    assert dataset.sweep.tolist() == dataset.mirror.tolist() == ["", ""]


def test_a_data_set_tells_what_is_in_it(dataset):
    assert len(dataset) == 18
    assert dataset.joint_names == ("shoulder", "elbow")
    assert dataset.markers == ("wrist", "finger")
    assert dataset.samples.tolist() == list(range(11, 20))
    assert np.flatnonzero(~dataset.measured).tolist() == [5]
    assert dataset.encoder_span.tolist() == [180.0, 89.0]


@pytest.mark.parametrize(
    ("changes", "error", "message"),
    [
        ({"encoders": np.zeros((18, 3))}, ValueError, "encoders must have shape (18, 2)"),
        ({"p_WH_measured": np.zeros((18, 2))}, ValueError, "must have shape (18, 3)"),
        ({"sample": np.arange(18.0)}, ValueError, "sample must hold whole numbers"),
        ({"marker": np.full(3, "hand")}, ValueError, "marker must hold text and have shape (18,)"),
        ({"sweep": np.zeros(18)}, ValueError, "sweep must hold text"),
        ({"joints": ()}, ValueError, "one or more JointInfo"),
        ({"name": ""}, ValueError, "the name of a data set must be printable"),
        ({"marker": np.tile(["a", "b "], 9)}, DataError, "row 1, column 'marker': a marker must"),
        ({"image_size": (640, 0)}, ValueError, "positive width and height"),
        ({"point_sigma_m": 0.0}, ValueError, "point_sigma_m must be positive"),
        ({"extra": {"sweep": ("",) * 18}}, ValueError, "a name of its own"),
        ({"extra": {"note": ("",)}}, ValueError, "18 texts, got 1"),
        ({"encoders": np.full((18, 2), np.nan)}, DataError, "reading of joint 'shoulder' is nan"),
        ({"marker": np.full(18, "hand")}, DataError, "row 1, column 'sample': sample 11 with"),
        ({"encoders": np.eye(18, 2)}, DataError, "all markers of one sample share one pose"),
        (
            {"sweep": np.full(18, "knee")},
            DataError,
            "there is no joint 'knee'; joints are shoulder",
        ),
        ({"sweep": np.tile(["home", ""], 9)}, DataError, "sample 11 has sweep '' here"),
        (
            {"p_WH_measured": np.tile([1, np.nan, 1], (18, 1))},
            DataError,
            "'y_m': the cell is empty",
        ),
        ({"pixels": np.tile([1, np.nan, 1, 1], (18, 1))}, DataError, "'left_v': the cell is empty"),
    ],
)
def test_a_data_set_that_contradicts_itself_is_refused(dataset, changes, error, message):
    with pytest.raises(error, match=re.escape(message)):
        replace(dataset, **changes)


def test_two_joints_of_one_name_are_refused(dataset, joints):
    with pytest.raises(DataError, match="joint 'elbow' appears more than once"):
        replace(dataset, joints=(joints[1], joints[1]))


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        (("home", "rad"), "uses that word"),
        (("a", "degrees"), "must be one of rad, deg, counts, got 'degrees'"),
        (("a", "counts"), "needs a positive counts_per_turn"),
        (("a", "rad", 4096), "leave it out or use 'counts'"),
        (("a", "rad", None, np.nan), "lower must be finite, got nan"),
        (("a", "rad", None, 2.0, 1.0), "lower must be less than upper"),
        (("a", "rad", None, None, None, 0), "sign must be 1 or -1"),
    ],
)
def test_a_joint_that_makes_no_sense_is_refused(fields, message):
    with pytest.raises(ValueError, match=re.escape(message)):
        JointInfo(*fields)


def test_a_turn_of_the_encoder_is_a_turn_in_every_unit():
    turns = {"counts": 4096.0, "rad": 2 * np.pi, "deg": 360.0}
    for unit, turn in turns.items():
        joint = JointInfo("a", unit, 4096 if unit == "counts" else None)
        assert turn * joint.radians_per_unit == pytest.approx(2 * np.pi, rel=1e-15)
        assert joint.still_tolerance == pytest.approx(1.0 if unit == "counts" else turn / 18000)


@pytest.mark.parametrize("rows", [[3, 0, 1], np.arange(18) < 4, np.array([], int)])
def test_rows_are_selected_by_index_or_mask(dataset, rows):
    index = np.arange(18)[rows]
    if not index.size:
        with pytest.raises(DataError, match="no rows"):
            dataset.select(rows)
        return
    part = dataset.select(rows)
    np.testing.assert_array_equal(part.p_WH_measured, dataset.p_WH_measured[index])
    assert part.marker.tolist() == dataset.marker[index].tolist()
    assert part.extra["note"] == tuple(dataset.extra["note"][i] for i in index)
    assert part.joints == dataset.joints


@pytest.mark.parametrize("rows", [[18], [True, False], [[0]], [0.5]])
def test_a_selection_that_fits_no_rows_is_refused(dataset, rows):
    with pytest.raises(ValueError, match="rows must be a mask of shape"):
        dataset.select(rows)


def test_a_split_keeps_poses_and_circles_whole(dataset):
    for seed in range(20):
        train, test = dataset.split(0.5, seed)
        assert (len(train), len(test)) == (14, 4)
        assert not set(train.samples) & set(test.samples)
        assert (test.sweep == "").all()


def test_the_same_seed_gives_the_same_split(dataset):
    def ids(seed):
        return dataset.split(0.5, seed)[1].samples.tolist()

    assert ids(1) == ids(1) == ids(np.random.default_rng(1))
    assert len({tuple(ids(seed)) for seed in range(10)}) > 1


def test_without_free_poses_the_test_part_comes_from_the_sweeps(dataset):
    circles = dataset.select(dataset.sweep != "")
    train, test = circles.split(0.5, 0)
    assert len(test.samples) == 2
    assert "home" in train.sweep
    assert "home" not in test.sweep


@pytest.mark.parametrize(("fraction", "held_out"), [(0.001, 1), (0.298, 34), (0.999, 113)])
def test_a_split_leaves_something_on_both_sides(joints, fraction, held_out):
    train, test = free_poses(114, joints).split(fraction, 0)
    assert (len(train), len(test)) == (114 - held_out, held_out)


def test_poses_that_nobody_saw_are_not_held_out(joints):
    points = np.full((10, 3), np.nan)
    points[4:6] = 0.1
    for seed in range(10):
        _, test = free_poses(10, joints, p_WH_measured=points).split(0.9, seed)
        assert set(test.samples) <= {4, 5}


@pytest.mark.parametrize("fraction", [0.0, 1.0, -1.0, np.nan])
def test_a_fraction_that_is_none_is_refused(dataset, fraction):
    with pytest.raises(ValueError, match="fraction must be between 0 and 1"):
        dataset.split(fraction, 0)


def test_one_pose_cannot_be_split(joints):
    with pytest.raises(DataError, match="cannot split: 1 poses"):
        free_poses(1, joints).split(0.5, 0)
