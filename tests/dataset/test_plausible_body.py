"""Recordings of bodies that cannot be what they say are refused when they are read."""

import warnings
from contextlib import nullcontext
from dataclasses import replace

import numpy as np
import pytest

from nico_selfmodel.dataset.body.body_folder import (
    is_body_dataset,
    load_body_dataset,
    save_body_dataset,
)
from nico_selfmodel.dataset.body.link_joint import LinkJoint
from nico_selfmodel.dataset.body.sensors import CAMERA, DISTANCE, SensorInfo
from nico_selfmodel.dataset.plausibility import stood_still
from nico_selfmodel.errors import DataError

from ..estimation.simulated_trees import one_arm, two_arms
from ..estimation.test_one_problem import KNOWN, flange_dataset, hand_eye_poses

AT_TWO_PLACES = (
    r"saw 'hand_tag0' at two places at once \({} times, first in sample 0\): tags of one id cannot"
)


def read_back(data, tmp_path):
    save_body_dataset(data, tmp_path / "data")
    return load_body_dataset(tmp_path / "data")


def longer(data, keep, columns):
    values = data.observations.values.copy()
    values[np.ix_(keep, columns)] *= 1000.0
    return replace(data, observations=replace(data.observations, values=values))


def test_distances_in_millimetres_are_refused(tmp_path):
    data = two_arms(1, poses=6, distances=KNOWN).data
    kinds = np.array([s.kind for s in data.sensors])[data.observations.sensor]
    assert (kinds == DISTANCE).any()
    with pytest.raises(DataError, match="were millimetres given as metres"):
        read_back(longer(data, np.flatnonzero(kinds == DISTANCE), [0]), tmp_path)


def test_one_marker_in_millimetres_on_its_link_is_refused(tmp_path):
    data = one_arm(1, poses=6).data
    markers = [replace(one, xyz=None) for one in data.markers]
    for unit in (1e-3, 1.0):
        markers[0] = replace(markers[0], xyz=(200.0 * unit, 30.0 * unit, 0.0))
        told = replace(data, markers=tuple(markers))
        wrong = pytest.raises(DataError, match=r"'xyz' of markers on links: up to 200 m: were mill")
        with wrong if unit == 1.0 else nullcontext():
            read_back(told, tmp_path / str(unit))


def test_a_table_of_observations_alone_lacks_its_poses(tmp_path):
    save_body_dataset(one_arm(1, poses=6).data, tmp_path / "data")
    (tmp_path / "data" / "poses.csv").unlink()
    assert is_body_dataset(tmp_path / "data")
    with pytest.raises(DataError, match=r"poses\.csv is missing"):
        load_body_dataset(tmp_path / "data")


@pytest.mark.parametrize(
    ("lens", "said"),
    [
        ({"fx": 600.0, "fy": 600.0}, "a lens needs cx, cy, got"),
        (
            {"fx": 31.0, "fy": 33.0, "cx": 320.0, "cy": 240.0},
            "are no focal lengths of images of 640",
        ),
        ({"fx": 33.0, "fy": 33.0, "cx": 320.0, "cy": 240.0}, None),
    ],
)
def test_a_lens_has_a_focal_length_in_pixels_and_a_middle(lens, said):
    entry = {"name": "cam", "kind": CAMERA, "image_size": [640, 480], "lens": lens}
    with nullcontext() if said is None else pytest.raises(DataError, match=said):
        SensorInfo.from_mapping(entry, "here")


def test_places_in_millimetres_are_refused(tmp_path):
    data = one_arm(1, poses=6).data
    with pytest.raises(DataError, match=r"up to .* m: were millimetres given as metres"):
        read_back(longer(data, np.arange(len(data.observations)), [0, 1, 2]), tmp_path)


def test_a_tracker_far_from_the_robot_is_taken(tmp_path):
    data = one_arm(1, poses=6).data
    values = data.observations.values + np.array([500.0, 0.0, 0.0, 0.0, 0.0, 0.0])
    far = replace(data, observations=replace(data.observations, values=values))
    np.testing.assert_array_equal(read_back(far, tmp_path).observations.values, values)


def test_rotation_vectors_in_degrees_are_refused(tmp_path):
    _, _, F, M = hand_eye_poses(np.random.default_rng(0), 5)
    data = flange_dataset(F, M)
    values = data.observations.values * [1.0, 1.0, 1.0, 57.3, 57.3, 57.3]
    with pytest.raises(DataError, match="were degrees given as radians"):
        read_back(replace(data, observations=replace(data.observations, values=values)), tmp_path)


def test_a_row_that_stands_there_twice_is_refused_with_both_lines(tmp_path):
    data = one_arm(1, poses=6, markers=2).data
    rows = np.append(np.arange(len(data.observations)), 4)
    with pytest.raises(DataError, match=r"line 14, column 'sample': .* as line 6: it would count"):
        read_back(data.of_rows(rows), tmp_path)


@pytest.mark.parametrize(
    ("poses", "apart", "said"),
    [
        (1, 1e-5, nullcontext()),
        (12, 5e-3, nullcontext()),
        (3, 5e-2, pytest.warns(UserWarning, match=AT_TWO_PLACES.format(3))),
        (4, 5e-2, pytest.raises(DataError, match=AT_TWO_PLACES.format(4))),
        (12, 5e-2, pytest.raises(DataError, match=AT_TWO_PLACES.format(12))),
    ],
)
def test_a_marker_at_two_places_at_once_is_refused_and_by_a_few_wrong_labels_warned_of(
    tmp_path, poses, apart, said
):
    data = one_arm(1, poses=12).data
    twice = data.of_rows(np.append(np.arange(12), np.arange(poses)))
    values = twice.observations.values.copy()
    values[12:, 0] += apart
    again = replace(twice, observations=replace(twice.observations, values=values))
    with said:
        assert len(read_back(again, tmp_path).observations) == 12 + poses


def test_tags_of_one_id_that_each_of_two_cameras_saw_a_few_times_at_once_are_refused(tmp_path):
    data = two_arms(1, poses=20, distances=KNOWN).data
    kinds = np.array([s.kind for s in data.sensors])[data.observations.sensor]
    own = (kinds == CAMERA) & (data.observations.marker == 0)
    names = {data.sensors[s].name for s in np.unique(data.observations.sensor[own])}
    assert len(names) == 2
    more = np.flatnonzero(own & (data.observations.pose < 8))
    twice = data.of_rows(np.append(np.arange(len(own)), more))
    values = twice.observations.values.copy()
    values[len(own) :, 0] += 200.0
    again = replace(twice, observations=replace(twice.observations, values=values))
    words = f"{', '.join(map(repr, sorted(names)))} saw .* at once .{len(more)} times"
    with pytest.raises(DataError, match=words):
        read_back(again, tmp_path)


def test_readings_of_a_joint_that_follows_are_refused(tmp_path):
    data = one_arm(1, joints=3, poses=6).data
    save_body_dataset(data, tmp_path / "data")
    head = tmp_path / "data" / "dataset.yaml"
    head.write_text(head.read_text().replace("parent: j1", "parent: j1\n  follows: {j1: -1}"))
    with pytest.raises(DataError, match=r"encoder\.j2': joint 'j2' follows j1, what an encoder"):
        load_body_dataset(tmp_path / "data")


def test_a_ratio_of_nothing_is_refused():
    with pytest.raises(ValueError, match=r"ratios of 'follows' must not be 0"):
        LinkJoint("elbow", follows={"shoulder": 0.0})


def again(data, copies):
    """Return a recording whose first samples stand in it once more, under numbers of their own."""
    table, more = data.observations, data.observations.pose < copies
    pose = np.concatenate([table.pose, table.pose[more] + len(data.sample)])
    columns = {"pose": pose}
    for key in ("sensor", "marker", "other", "values", "mirror"):
        column = np.asarray(getattr(table, key))
        columns[key] = np.concatenate([column, column[more]])
    rows = np.concatenate([np.arange(len(data.sample)), np.arange(copies)])
    sample = np.concatenate([data.sample, data.sample.max() + 1 + np.arange(copies)])
    return replace(
        data,
        sample=sample,
        readings=data.readings[rows],
        flanges=data.flanges[rows],
        approach=data.approach[rows],
        observations=replace(table, **columns),
    )


@pytest.mark.parametrize(("copies", "refused"), [(12, True), (3, False)])
def test_a_recording_of_which_much_stands_there_again_is_refused(tmp_path, copies, refused):
    data = again(one_arm(1, poses=12).data, copies)
    if not refused:
        with pytest.warns(UserWarning, match="3 of 15 observations are of one pose and the same"):
            assert len(read_back(data, tmp_path).observations) == 12
        return
    with pytest.raises(DataError, match="are copies, to the last digit, of earlier ones"):
        read_back(data, tmp_path)


def logged_again(data, times, jitter):
    """Return a recording of which each sample is logged some times, one after the other."""
    count, table = len(data.sample), data.observations
    rows, again = np.repeat(np.arange(count), times), np.repeat(np.arange(len(table)), times)
    nth = np.tile(np.arange(times), len(table))
    made = {key: getattr(table, key)[again] for key in ("sensor", "marker", "other", "mirror")}
    values = table.values[again] + jitter * nth[:, None]
    return replace(
        data,
        sample=np.arange(count * times),
        readings=data.readings[rows],
        flanges=data.flanges[rows],
        approach=data.approach[rows],
        observations=replace(table, pose=table.pose[again] * times + nth, values=values, **made),
    )


@pytest.mark.parametrize("jitter", [0.0, 1e-9])
def test_rows_that_are_logged_again_count_once_and_measurements_of_a_standing_robot_all(
    tmp_path, jitter
):
    data = logged_again(one_arm(1, poses=12, markers=2).data, 4, jitter)
    if jitter:
        assert len(read_back(data, tmp_path).observations) == 96
        return
    with pytest.warns(UserWarning, match=r"72 of 96 .* tell nothing new, they count once"):
        kept = read_back(data, tmp_path)
    np.testing.assert_array_equal(np.unique(kept.observations.pose), np.arange(0, 48, 4))
    assert (kept.pose == np.repeat(np.arange(12), 4)).all()


def test_pixels_outside_their_images_are_warned_of(tmp_path):
    data = two_arms(1, poses=6, distances=KNOWN).data
    assert all(s.image_size == (640, 480) for s in data.sensors if s.kind == CAMERA)
    small = [replace(s, image_size=(320, 240)) if s.kind == CAMERA else s for s in data.sensors]
    with pytest.warns(UserWarning, match=r"pixels up to .* in images of 320 x 240"):
        read_back(replace(data, sensors=tuple(small)), tmp_path)


def test_places_of_markers_in_millimetres_are_refused(tmp_path):
    data = one_arm(1, poses=6, markers=2).data
    far = replace(data.markers[0], xyz=(100.0, 0.0, 0.0)), replace(data.markers[1], xyz=(0, 0, 0))
    with pytest.raises(DataError, match=r"'xyz' of markers: up to .* m: were millimetres given"):
        read_back(replace(data, markers=(*far, *data.markers[2:])), tmp_path)


def in_degrees(data, rows, unit=180.0 / np.pi):
    readings = data.readings.copy()
    readings[rows] *= unit
    return replace(data, readings=readings)


def test_samples_in_degrees_among_samples_in_radians_are_refused_with_their_numbers(tmp_path):
    data = two_arms(1, poses=12).data
    with pytest.raises(DataError, match=r"in 4 samples \(8 to 11\), .* degrees given as radians"):
        read_back(in_degrees(data, slice(8, 12)), tmp_path)


def test_a_recording_all_in_degrees_is_questioned_once_for_all_joints(tmp_path):
    data = in_degrees(two_arms(1, poses=12).data, slice(None))
    with pytest.warns(UserWarning, match="set encoder_unit: deg") as said:
        read_back(data, tmp_path)
    assert len(said) == 1


def test_joints_that_turn_many_times_are_taken(tmp_path):
    data = two_arms(1, poses=12).data
    turns = np.linspace(-40.0, 40.0, 12)[:, None] * 0.99 ** np.arange(len(data.joints))
    with pytest.warns(UserWarning, match="12.7 turns"):
        read_back(replace(data, readings=turns), tmp_path)


def test_nothing_is_saved_that_could_not_be_loaded_again(tmp_path):
    data = one_arm(1, poses=6, markers=2).data
    rows = np.append(np.arange(len(data.observations)), 4)
    far = longer(data, np.arange(len(data.observations)), [0, 1, 2])
    for wrong, why in ((data.of_rows(rows), "line 14, .* as line 6"), (far, "were millimetres")):
        with pytest.raises(DataError, match=why):
            save_body_dataset(wrong, tmp_path / "data")
        assert not (tmp_path / "data").exists()


def test_what_a_crane_or_a_speck_does_is_taken_with_a_warning(tmp_path):
    """Points within 100 m of their middle: more is no machine, 20 m to 2.5 mm need no word."""
    data = one_arm(1, poses=6).data
    places = data.observations.values[:, :3]
    reach = np.abs(places - np.median(places, axis=0)).max()

    def of_size(metres):
        values = data.observations.values.copy()
        values[:, :3] *= metres / reach
        return replace(data, observations=replace(data.observations, values=values))

    for metres in (21.0, 99.0):
        with pytest.warns(UserWarning, match="were millimetres given as metres"):
            read_back(of_size(metres), tmp_path / f"{metres}")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        read_back(of_size(19.0), tmp_path / "19")
        read_back(of_size(0.0026), tmp_path / "0.0026")
    with pytest.warns(UserWarning, match="were metres given as millimetres"):
        read_back(of_size(0.0024), tmp_path / "0.0024")
    with pytest.raises(DataError, match=r"up to 101 m: were millimetres given as metres"):
        read_back(of_size(101.0), tmp_path / "101")


def test_places_that_are_exactly_nothing_are_refused(tmp_path):
    data = one_arm(1, poses=12).data
    values = data.observations.values.copy()
    values[[1, 4], :3] = 0.0
    wrong = replace(data, observations=replace(data.observations, values=values))
    with pytest.raises(DataError, match="are exactly 0 in 2 rows"):
        read_back(wrong, tmp_path)


@pytest.mark.parametrize(("turned", "still"), [(0.0, True), (0.09, True), (0.11, False)])
def test_joints_that_hardly_moved_do_not_tell_how_large_their_robot_is(turned, still):
    readings = np.column_stack([np.linspace(0.0, turned, 5), np.full(5, np.nan)])
    assert stood_still(readings) is still
    assert not stood_still(readings[:, 1:])  # of a flange nobody knows
