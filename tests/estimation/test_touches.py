"""Touches as observations: markers that meet, and planes that they meet, of unknown place."""

import csv
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from nico_selfmodel.dataset.body.body_dataset import COLUMNS, BodyDataset, ObservationTable
from nico_selfmodel.dataset.body.body_folder import load_body_dataset, save_body_dataset
from nico_selfmodel.dataset.body.sensors import MarkerInfo, SensorInfo
from nico_selfmodel.errors import DataError
from nico_selfmodel.estimation.judging import judge
from nico_selfmodel.estimation.results.calibration_result import LAST
from nico_selfmodel.estimation.results.fixed_parameters import FixedParameters
from nico_selfmodel.estimation.tree import tree_findings
from nico_selfmodel.estimation.tree.contradictions.contradiction_words import missed_touches
from nico_selfmodel.estimation.tree.guesses.touch_guess import Touches
from nico_selfmodel.estimation.tree.tree_calibration import calibrate_tree
from nico_selfmodel.estimation.tree.tree_errors import errors_of
from nico_selfmodel.estimation.tree.tree_observations import TreeObservations
from nico_selfmodel.estimation.tree.tree_result import body_model, tree_result
from nico_selfmodel.estimation.tree.tree_setup import Description, Wishes
from nico_selfmodel.geometry.transform import transform
from nico_selfmodel.model.tree.body_model import load_body, save_body
from nico_selfmodel.model.tree.body_tree import Attached
from nico_selfmodel.model.tree.tree_motion import TreeMotion

from ..slow_rest import slow_rest
from .simulated_trees import one_arm, turned, two_arms

MISS = 1e-4
"""Standard deviation of a touch [m]."""
NORMAL = np.array([0.36, -0.48, 0.8])
HEIGHT = 0.35
APART = 0.06


def with_balls(true, links, xyz=(0.01, -0.02, 0.08)):
    """A body with a ball on some links, which nothing sees, and its recording so far."""
    tree, data = true.tree, true.data
    names = [f"{link}_ball" for link in links]
    balls = [Attached(n, tree.joints.index(link), transform(np.eye(3), np.array(xyz)))
             for n, link in zip(names, links, strict=True)]  # fmt: skip
    markers = (*data.markers, *(MarkerInfo(n, on) for n, on in zip(names, links, strict=True)))
    tree = tree.with_markers((*tree.markers, *balls))
    return tree, replace(data, markers=markers), [len(data.markers) + k for k in range(len(links))]


def touching(tree, q, gap):
    """Move joints until `gap` of a motion is zero in each pose: a touch is where it is."""
    q = q.copy()
    for _ in range(30):
        off = gap(TreeMotion.at(tree, q))
        steps = 1e-6 * np.eye(q.shape[1])
        J = np.stack([(gap(TreeMotion.at(tree, q + step)) - off) / 1e-6 for step in steps])
        weight = np.sum(J**2, axis=0)
        q -= np.clip(off / np.maximum(weight, 1e-3) * J, -0.2, 0.2).T
    met = np.abs(gap(TreeMotion.at(tree, q))) < 1e-9
    return q[met]


def joined_with(data, q, sensor, marker, other=-1, seen=None):
    """Add poses of touches to a recording; `seen` has what other sensors measured at them."""
    table, first, count = data.observations, len(data.sample), len(q)
    own = ObservationTable(
        first + np.arange(count),
        np.full(count, len(data.sensors)),
        np.broadcast_to(marker, count),
        np.broadcast_to(other, count),
        np.full((count, 6), np.nan),
    )
    tables = [table, own]
    if seen is not None:
        tables.append(replace(seen, pose=seen.pose + first))
    columns = [np.concatenate([getattr(t, key) for t in tables]) for key in COLUMNS]
    return BodyDataset(
        data.name,
        data.joints,
        data.markers,
        (*data.sensors, sensor),
        np.arange(first + count),
        np.vstack([data.readings, q]),
        ObservationTable(*columns),
    )


def plane_gap(marker):
    """Height of a marker over the plane."""
    return lambda motion: NORMAL @ motion.pose_of(motion.tree.markers[marker])[1] - HEIGHT


def pair_gap(one, two):
    """How much further apart two markers are than where they touch."""

    def gap(motion):
        ends = [motion.pose_of(motion.tree.markers[m])[1] for m in (one, two)]
        return np.linalg.norm(ends[0] - ends[1], axis=0) - APART

    return gap


def arm_at_a_plane(seed, touches=40, **info):
    """An arm before a tracker, which also touched a plane with a ball that nothing sees."""
    true = one_arm(seed, poses=60, markers=3, joint_sigma=np.radians(0.02))
    tree, data, (ball,) = with_balls(true, ["j5"])
    rng = np.random.default_rng((seed, 1))
    q = rng.uniform(-1.2, 1.2, size=(4 * touches, 5))
    noisy = touching(tree, q, plane_gap(ball))[:touches]
    read = noisy + np.radians(0.02) * rng.normal(size=noisy.shape)
    return tree, joined_with(data, read, SensorInfo("table", "plane", **info), ball), ball


def hands_that_meet(seed, touches=40):
    """Two arms before two cameras, whose balls met at a distance that nobody knows."""
    true = two_arms(seed, poses=40, tags_each=4, distances=(("left_tag0", "left_tag1"),))
    tree, data, balls = with_balls(true, ["left6", "right6"])
    rng = np.random.default_rng((seed, 1))
    q = rng.uniform(-1.0, 1.0, size=(4 * touches, 13)) * [0.4, *[1.0] * 12]
    met = touching(tree, q, pair_gap(*balls))[:touches]
    read = met + np.radians(0.05) * rng.normal(size=met.shape)
    return tree, joined_with(data, read, SensorInfo("bump", "contact"), *balls), balls


@pytest.fixture(scope="module")
def at_a_plane():
    """What was learned of an arm at a plane, and the truth."""
    tree, data, ball = arm_at_a_plane(3)
    return tree, data, ball, calibrate_tree(data, effects=())


@pytest.mark.slow
def test_a_plane_that_nobody_knows_is_found_with_the_ball_that_touched_it(at_a_plane):
    tree, _, ball, found = at_a_plane
    (plane,) = found.tree.planes
    assert np.degrees(np.arccos(min(abs(plane.X_LA[:3, 2] @ NORMAL), 1.0))) < 0.2
    assert judge(tree_result(found)).status == "NOT_EVALUATED"
    names = found.uncertainty.names
    sigma = max(found.uncertainty.sigma[names.index(f"j5_ball.{part}")] for part in "xyz")
    assert sigma < 2e-3
    for seen in range(3):
        true, now = (
            np.linalg.norm(np.subtract(*(t.markers[m].X_LA[:3, 3] for m in (ball, seen))))
            for t in (tree, found.tree)
        )
        assert abs(true - now) < 4.0 * sigma


def test_what_touches_miss_is_told(at_a_plane):
    _, data, _, found = at_a_plane
    document = tree_result(found).details["touches"]["table"]
    assert document["n"] == int(np.sum(data.observations.sensor == 1))
    assert 0.0 < document["rms_mm"] < 1.0
    assert np.linalg.norm(document["normal"]) == pytest.approx(1.0)


def test_planes_and_contacts_come_back_from_a_body_file(at_a_plane, tmp_path):
    found = at_a_plane[3]
    model = body_model(found)
    model = replace(model, tree=replace(model.tree, contacts={"bump": 0.05}))
    save_body(model, tmp_path / "body.yaml")
    again = load_body(tmp_path / "body.yaml").tree
    assert again.contacts == {"bump": 0.05}
    assert again.planes[0].X_LA.tolist() == model.tree.planes[0].X_LA.tolist()


def test_a_recording_with_touches_comes_back_from_its_folder(at_a_plane, tmp_path):
    data = at_a_plane[1]
    save_body_dataset(data, tmp_path / "data")
    again = load_body_dataset(tmp_path / "data")
    for key in COLUMNS:
        now, before = (getattr(one.observations, key) for one in (again, data))
        np.testing.assert_array_equal(now, before)
    assert [s.kind for s in again.sensors] == ["points", "plane"]


@pytest.mark.slow
def test_the_distance_at_which_hands_meet_is_found():
    data = hands_that_meet(1)[1]
    found = calibrate_tree(data, effects=())
    apart = found.tree.contacts["bump"]
    i = found.uncertainty.names.index("bump.distance")
    sigma = found.uncertainty.sigma[i]
    assert abs(apart - APART) < 3.5 * sigma
    assert sigma < 2e-3
    assert judge(tree_result(found)).status == "NOT_EVALUATED"


def only_observed(data):
    """What a calibration says of observations, without one."""
    observed = SimpleNamespace(observations=TreeObservations.of(data))
    return SimpleNamespace(data=data, train=observed)


def test_twenty_poses_with_touches_tell_their_standard_deviation_and_fewer_do_not(at_a_plane):
    data = at_a_plane[1]
    touched = np.flatnonzero(data.observations.sensor == 1)
    for count, held in ((20, False), (19, True)):
        rows = np.append(np.flatnonzero(data.observations.sensor == 0), touched[:count])
        few = data.of_rows(np.sort(rows))
        assert TreeObservations.of(few).sigma_held.tolist() == [False, False, held]
        words = tree_findings._assumed_sigmas(only_observed(few))
        assert ["'table' to 1 mm is assumed" in word for word in words] == [True] * held
    stated = (data.sensors[0], replace(data.sensors[1], sigma=1e-4))
    few = replace(few, sensors=stated)
    assert TreeObservations.of(few).sigma_held.tolist() == [False, False, True]
    assert not tree_findings._assumed_sigmas(only_observed(few))


@pytest.mark.slow
def test_a_distance_that_is_known_tells_how_large_the_body_is():
    tree, data, _ = hands_that_meet(2)
    sensors = np.array([s.kind == "distance" for s in data.sensors])
    data = data.of_rows(~sensors[data.observations.sensor])
    assert calibrate_tree(data, effects=()).setup.scale_from is None
    told = Wishes(FixedParameters({"bump.distance": APART}))
    found = calibrate_tree(data, wishes=told, effects=())
    assert found.setup.scale_from == "bump.distance"
    ends = [np.linalg.norm(np.subtract(*(t.sensors[k].X_LA[:3, 3] for k in (0, 1))))
            for t in (tree, found.tree)]  # fmt: skip
    assert ends[1] / ends[0] == pytest.approx(1.0, abs=0.02)


@pytest.mark.slow
def test_touches_noted_at_poses_that_touched_nothing_fail_and_are_named(at_a_plane):
    _, data, _, sound = at_a_plane
    assert not any("is missed by" in said for said in tree_result(sound).texts(LAST))
    table = data.observations
    pose = np.where(table.sensor == 1, table.pose - 60, table.pose)
    mixed = replace(data, observations=replace(table, pose=pose))
    failed = tree_result(calibrate_tree(mixed, effects=())).texts(LAST)
    assert any("what 'table' tells is missed by" in said for said in failed)


@pytest.mark.parametrize(("off", "named"), [(0.0299, 0), (0.0301, 1)])
def test_touches_that_are_missed_by_three_hundredths_of_the_body_tell_nothing(off, named):
    left = SimpleNamespace(of_touches=lambda keep: {"table": np.full(int(keep.sum()), 2.0 * off)})
    solution = SimpleNamespace(outliers=np.array([False, False, True]))
    found = missed_touches(SimpleNamespace(train=left, solution=solution, size=2.0))
    assert len(found) == named


def test_touches_alone_correct_a_robot_that_is_described():
    tree, data, ball = arm_at_a_plane(5, touches=90)
    rng = np.random.default_rng(0)
    only = data.of_rows(data.observations.sensor == 1)
    sample = np.isin(np.arange(len(data.sample)), only.observations.pose)
    seen = only.select(sample)
    place = tuple(tree.markers[ball].X_LA[:3, 3].tolist())
    markers = tuple(replace(m, xyz=place) if m.name == "j5_ball" else m for m in seen.markers)
    seen = replace(seen, markers=markers, sensors=seen.sensors)
    train, test = seen.split(0.33, seed=0)
    off = replace(tree, X_PJ=np.array([X @ turned(rng, 0.3, 3.0) for X in tree.X_PJ]))
    off = replace(off, planes=(Attached("table", -1),))
    found = calibrate_tree(train, test=test, description=Description(off), effects=())
    left, described = (e.by_row() for e in (found.test, found.described))
    assert np.median(left) < 0.4 * np.median(described)
    assert tree_result(found).test.position is not None


@pytest.mark.slow
@pytest.mark.parametrize("touches", [30, 60])
def test_touches_alone_do_not_explain_a_description_away(touches):
    tree, data, _ = arm_at_a_plane(8, touches=touches)
    only = data.of_rows(data.observations.sensor == 1)
    sample = np.isin(np.arange(len(data.sample)), only.observations.pose)
    rng = np.random.default_rng(1)
    off = replace(tree, X_PJ=np.array([X @ turned(rng, 0.3, 3.0) for X in tree.X_PJ]))
    off = replace(off, planes=(Attached("table", -1),))
    found = calibrate_tree(only.select(sample), description=Description(off), effects=())
    # 30 numbers for 36 parameters; and a body of no size touches the plane everywhere.
    assert found.solution.variances_known
    assert not found.solution.outliers.any()
    assert 0.005 < np.degrees(found.solution.noise.joint[0]) < 0.06
    off_by = tree_result(found).details["description_off"]
    assert off_by["turn_sigma_deg"] < 0.5
    assert 1.0 < off_by["shift_sigma_mm"] < 4.0


@pytest.mark.parametrize("seed", slow_rest([1, 2, 3, 4]))
def test_a_ball_that_nothing_sees_begins_where_what_it_touched_is_flat(seed):
    true = one_arm(seed, poses=4, markers=1, joint_sigma=0.0)
    tree, data, (ball,) = with_balls(true, ["j5"], xyz=(0.05, -0.1, 0.4))
    q = np.random.default_rng((seed, 1)).uniform(-1.2, 1.2, size=(300, 5))
    q = touching(tree, q, plane_gap(ball))[:50]
    seen = joined_with(data, q, SensorInfo("table", "plane"), ball)
    only = seen.of_rows(seen.observations.sensor == 1)
    rng = np.random.default_rng(seed)
    off = replace(tree, X_PJ=np.array([X @ turned(rng, 0.5, 5.0) for X in tree.X_PJ]))
    off = replace(off, planes=(Attached("table", -1),)).with_markers(
        tuple(replace(m, X_LA=np.eye(4)) for m in off.markers)
    )
    placed = Touches.of(only).placed(off)
    assert placed.markers[ball].X_LA[:3, 3] == pytest.approx([0.05, -0.1, 0.4], abs=0.05)
    assert abs(placed.planes[0].X_LA[:3, 2] @ NORMAL) > np.cos(np.radians(5.0))


def test_touches_alone_tell_no_body_from_nothing():
    _, data, _ = arm_at_a_plane(3)
    with pytest.raises(DataError, match="touches and distances alone cannot tell a body"):
        calibrate_tree(data.of_rows(data.observations.sensor == 1))


def test_a_plane_that_was_touched_along_a_line_is_refused():
    data = arm_at_a_plane(3)[1]
    rows = np.flatnonzero(data.observations.sensor == 1)
    keep = np.isin(np.arange(len(data.observations)), rows[:2]) | (data.observations.sensor == 0)
    with pytest.raises(DataError, match=r"touched plane 'table'.*three places or more"):
        calibrate_tree(data.of_rows(keep))


def test_a_plane_is_held_only_against_a_told_place():
    told = Wishes(FixedParameters({"table.rx": 0.0}))
    _, data, _ = arm_at_a_plane(3)
    with pytest.raises(ValueError, match="told place of plane 'table'"):
        calibrate_tree(data, wishes=told)


@pytest.mark.slow
def test_a_plane_whose_turn_is_told_keeps_it():
    z = NORMAL
    x = np.cross(z, [1.0, 0.0, 0.0])
    x /= np.linalg.norm(x)
    pose = transform(np.column_stack([x, np.cross(z, x), z]), HEIGHT * z)
    _, data, _ = arm_at_a_plane(3, X_LS=pose)
    told = Wishes(FixedParameters({"table.rx": 0.0, "table.ry": 0.0}))
    found = calibrate_tree(data, wishes=told, effects=())
    assert found.tree.planes[0].X_LA[:3, 2] == pytest.approx(NORMAL)
    assert {"table.z"} == {n for n in found.uncertainty.names if n.startswith("table")}


def test_touches_that_a_body_does_not_know_are_named(at_a_plane):
    _, data, _, found = at_a_plane
    without = replace(found.tree, planes=())
    with pytest.raises(DataError, match="touches of table, which the body does not know"):
        errors_of(without, data)


@pytest.mark.parametrize(
    ("spoil", "says"),
    [
        (lambda row: row | {"other": "hand_tag1"}, "a distance or contact, and nothing else"),
        (lambda row: row | {"x_m": "0.1"}, "measures no number, all of them and nothing else"),
        (lambda row: row | {"sample": ""}, "has no sample"),
    ],
)
def test_rows_of_planes_with_what_planes_have_not_are_refused(spoil, says, at_a_plane, tmp_path):
    save_body_dataset(at_a_plane[1], tmp_path / "data")
    path = tmp_path / "data" / "observations.csv"
    with path.open() as file:
        rows = list(csv.DictReader(file))
    names = [*rows[0], "other"]
    rows = [spoil(row) if row["sensor"] == "table" else row for row in rows]
    with path.open("w", newline="") as file:
        writer = csv.DictWriter(file, names)
        writer.writeheader()
        writer.writerows(rows)
    with pytest.raises(DataError, match=says):
        load_body_dataset(tmp_path / "data")
