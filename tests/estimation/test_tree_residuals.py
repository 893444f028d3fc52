"""Derivatives of every sensor by everything that a body has, against central differences."""

from dataclasses import replace

import numpy as np
import pytest

from nico_selfmodel.dataset.body.body_dataset import COLUMNS, BodyDataset, ObservationTable
from nico_selfmodel.dataset.body.link_joint import LinkJoint, coupling_of, parents_of
from nico_selfmodel.dataset.body.sensors import PAIRS, SENSOR_COLUMNS, MarkerInfo, SensorInfo
from nico_selfmodel.estimation.tree.forward.tree_residuals import TreeResiduals
from nico_selfmodel.estimation.tree.tree_observations import TreeObservations
from nico_selfmodel.estimation.tree.tree_parameters import FRAME_PARTS, TreeParameters
from nico_selfmodel.geometry.plane import Plane
from nico_selfmodel.geometry.rotation import rotation_from_vector, rotation_vectors_of
from nico_selfmodel.geometry.transform import transform
from nico_selfmodel.model.arm.bending import PARTS, Bending
from nico_selfmodel.model.cameras.camera import Camera
from nico_selfmodel.model.cameras.mirror import Mirror
from nico_selfmodel.model.tree.body_tree import Attached, BodyTree
from nico_selfmodel.model.tree.standing_mirror import StandingMirror

from ..slow_rest import slow_rest

SIZE = (640, 480)
JOINTS = (
    LinkJoint("a"),
    LinkJoint("b", parent="a"),
    LinkJoint("c", parent="b", motion="prismatic", encoder_unit="m"),
    LinkJoint("d", parent="a", encoder_unit="counts", counts_per_turn=1000.0),
    LinkJoint("e", parent="d", follows={"b": 0.5, "d": -1.0}),
    LinkJoint("f", parent="world", motion="flange", encoder_unit="pose"),
)
MARKERS = tuple(MarkerInfo(f"m_{on}", on) for on in ("c", "e", "f", "world"))
SENSORS = (
    SensorInfo("tracker", "points"),
    SensorInfo("poses", "poses"),
    SensorInfo("camera", "camera", "d", image_size=SIZE),
    SensorInfo("touch", "distance"),
)


@pytest.fixture(scope="module")
def scene():
    """A body with every kind of joint and sensor, and random observations of it."""
    rng = np.random.default_rng(0)

    def place():
        return transform(rotation_from_vector(rng.normal(size=3)), 0.3 * rng.normal(size=3))

    count, poses = 60, 7
    sensor, marker = rng.integers(0, 4, count), rng.integers(0, 4, count)
    values = np.full((count, 6), np.nan)
    for row, s in enumerate(sensor.tolist()):
        k = len(SENSOR_COLUMNS[SENSORS[s].kind])
        values[row, :k] = rng.normal(size=k)
    other = np.where(sensor == 3, (marker + 1) % 4, -1)
    readings = rng.normal(size=(poses, 6)) * [1.0, 1.0, 1.0, 150.0, np.nan, np.nan]
    flanges = np.full((poses, 6, 6), np.nan)
    flanges[:, 5] = rng.normal(size=(poses, 6))
    table = ObservationTable(rng.integers(0, poses, count), sensor, marker, other, values)
    data = BodyDataset("all", JOINTS, MARKERS, SENSORS, np.arange(poses), readings, table, flanges)
    far = transform(np.eye(3), [0.0, 0.0, -6.0])
    tree = BodyTree(
        data.joint_names,
        tuple(joint.motion for joint in JOINTS),
        parents_of(JOINTS),
        np.stack([place() for _ in JOINTS]),
        1.0 + 0.2 * rng.random(6),
        coupling_of(JOINTS),
        tuple(Attached(m.name, data.on_link(m.on), place()) for m in MARKERS),
        tuple(
            Attached(s.name, data.on_link(s.on), far if s.kind == "camera" else place())
            for s in SENSORS[:3]
        ),
        {"camera": Camera(500.0, 500.0, 320.0, 240.0, SIZE, k1=0.01)},
    )
    parameters = TreeParameters(tree)
    x = parameters.values_of(tree)
    x = x + np.where(np.array(parameters.units) == "px", 0.0, 0.1) * rng.normal(size=len(x))
    return data, parameters, x


@pytest.fixture(scope="module")
def mirrored(scene):
    """The same body, most of what its camera saw being reflections in one of two mirrors."""
    data, parameters, x = scene
    rng = np.random.default_rng(5)
    table = data.observations
    names = np.where(table.sensor == 2, rng.choice(["", "hall", "door"], len(table)), "")
    walls = [rng.normal(size=3) for _ in range(2)]
    planes = [Plane(n / np.linalg.norm(n), 2.0) for n in walls]
    mirrors = tuple(map(StandingMirror, ("door", "hall"), planes))
    both = TreeParameters(replace(parameters.base, mirrors=mirrors))
    tree = parameters.tree_of(x).with_mirrors(mirrors)
    y = both.values_of(tree)
    assert both.names[-6:] == (*Mirror.names_of("door"), *Mirror.names_of("hall"))
    return replace(data, observations=replace(table, mirror=names)), both, y


@pytest.fixture(scope="module")
def touched(scene):
    """The same body, whose markers also touch each other and planes that stand or are carried."""
    data, parameters, x = scene
    rng = np.random.default_rng(6)
    new = (
        SensorInfo("bump", "contact"),
        SensorInfo("tray", "plane", "b"),
        SensorInfo("wall", "plane"),
        SensorInfo("knock", "contact"),
    )
    count, table = 40, data.observations
    sensor, marker = rng.integers(0, 4, count), rng.integers(0, 4, count)
    pairs = np.array([s.kind in PAIRS for s in new])[sensor]
    own = ObservationTable(
        rng.integers(0, len(data.sample), count),
        len(SENSORS) + sensor,
        marker,
        np.where(pairs, (marker + 1) % 4, -1),
        np.full((count, 6), np.nan),
    )
    both = (np.concatenate([getattr(t, key) for t in (table, own)]) for key in COLUMNS)
    places = rng.normal(size=(2, 6))
    planes = tuple(
        Attached(name, data.on_link(on), transform(rotation_from_vector(at[:3]), 0.3 * at[3:]))
        for (name, on), at in zip((("tray", "b"), ("wall", "world")), places, strict=True)
    )
    contacts = {"bump": 0.3, "knock": 0.1}
    told = TreeParameters(replace(parameters.base, planes=planes, contacts=contacts))
    tree = replace(parameters.tree_of(x), planes=planes, contacts=contacts)
    y = told.values_of(tree)
    y[[told.index[f"{plane.name}.{part}"] for plane in planes for part in FRAME_PARTS]] += 0.1
    sensors = (*data.sensors, *new)
    return replace(data, sensors=sensors, observations=ObservationTable(*both)), told, y


@pytest.mark.parametrize("bearings", slow_rest([True, False]))
@pytest.mark.parametrize("which", ["scene", "mirrored", "touched"])
def test_every_parameter_moves_the_residuals_as_its_derivative_says(which, bearings, request):
    data, parameters, x = request.getfixturevalue(which)
    observations = TreeObservations.of(data)
    if bearings:
        observations = observations.as_bearings(parameters.base.lenses)
    residuals = TreeResiduals(observations, parameters)
    linear = residuals.linear(x)
    assert linear.r == pytest.approx(residuals.residuals(x))
    for i, name in enumerate(parameters.names):
        if bearings and name in parameters.of_lenses:
            continue
        step = np.zeros(len(x))
        step[i] = 1e-6 * max(1.0, abs(x[i]) / 100.0)
        moved = residuals.residuals(x + step) - residuals.residuals(x - step)
        slope = moved / (2.0 * step[i])
        assert linear.J[i] == pytest.approx(slope, abs=2e-6 * (1.0 + np.abs(slope).max())), name


@pytest.mark.parametrize("which", ["scene", "mirrored", "touched"])
def test_wrong_readings_move_the_residuals_as_their_derivatives_say(which, request):
    data, parameters, x = request.getfixturevalue(which)
    residuals = TreeResiduals(TreeObservations.of(data), parameters)
    linear, gear = residuals.linear(x), parameters.tree_of(x).gear

    def read(i, part, h):
        if JOINTS[i].motion != "flange":
            off = data.readings.copy()
            off[:, i] += h * gear[i] / JOINTS[i].si_per_unit
            return replace(data, readings=off)
        off = np.array(data.flanges)
        if part < 3:
            turn = rotation_from_vector(h * np.eye(3)[part])
            turned = rotation_from_vector(off[:, i, 3:]) @ turn
            off[:, i, 3:] = rotation_vectors_of(turned)
        else:
            off[:, i, part - 3] += h
        return replace(data, flanges=off)

    for m, (i, part) in enumerate(residuals.observations.noisy_joints):
        both = [
            TreeResiduals(TreeObservations.of(read(i, part, h)), parameters).residuals(x)
            for h in (1e-6, -1e-6)
        ]
        slope = (both[0] - both[1]) / 2e-6
        assert linear.by_joint[:, m] == pytest.approx(slope, abs=2e-6 * (1 + np.abs(slope).max()))


@pytest.mark.parametrize("which", ["scene", "mirrored", "touched"])
def test_values_of_a_body_are_those_that_it_was_made_of(which, request):
    _, parameters, x = request.getfixturevalue(which)
    again = parameters.values_of(parameters.tree_of(x))
    # A turn by more than half a round is written down as the shorter one the other way.
    turns = np.array(parameters.units) == "rad"
    turns[parameters.gears.start :] = False
    assert again[~turns] == pytest.approx(x[~turns])
    one, two = (rotation_from_vector(v[turns].reshape(-1, 3)) for v in (again, x))
    assert one == pytest.approx(two, abs=1e-9)


@pytest.mark.slow
@pytest.mark.parametrize("which", ["scene", "mirrored", "touched"])
def test_what_bends_moves_the_residuals_as_its_derivative_says(which, request):
    data, parameters, _ = request.getfixturevalue(which)
    rng = np.random.default_rng(3)
    n = len(data.joints)
    loads, pivots = 0.3 * rng.normal(size=(n, 3)), 0.2 * rng.normal(size=n)
    still = Bending.none(data.joint_names, np.eye(3)[2], loads, pivots).with_effects(*PARTS)
    bent = parameters.with_bending(still)
    tree = replace(parameters.base, bending=still)
    x = bent.values_of(tree)
    x[bent.bends] += 1e-3 * rng.normal(size=len(still.names))
    data = replace(data, approach=rng.choice([-1, 0, 1], data.readings.shape))
    residuals = TreeResiduals(TreeObservations.of(data), bent)
    linear = residuals.linear(x)
    first = bent.bends.start
    assert bent.names[first:] == still.names
    for i, name in enumerate(still.names, start=first):
        step = np.zeros(len(x))
        step[i] = 1e-6
        slope = (residuals.residuals(x + step) - residuals.residuals(x - step)) / 2e-6
        turns = JOINTS[data.joint_names.index(name.split(".")[0])].motion == "revolute"
        if turns or ".load" in name:
            assert linear.J[i] == pytest.approx(slope, abs=3e-3 * (1e-3 + np.abs(slope).max())), (
                name
            )
        else:
            assert not linear.J[i].any(), name


@pytest.mark.slow
@pytest.mark.parametrize("which", ["scene", "mirrored", "touched"])
def test_about_joint_errors_all_is_linear_where_the_joints_are_then(which, request):
    data, parameters, x = request.getfixturevalue(which)
    observations, rng = TreeObservations.of(data), np.random.default_rng(3)
    read = [JOINTS[i].motion != "flange" for i, _ in observations.noisy_joints]
    errors = 0.2 * rng.normal(size=(len(data.sample), len(read))) * read

    def shown(x, errors):
        off, gear = data.readings.copy(), parameters.tree_of(x).gear
        for m, (i, _) in enumerate(observations.noisy_joints):
            if read[m]:
                off[:, i] += errors[:, m] * gear[i] / JOINTS[i].si_per_unit
        erring = TreeObservations.of(replace(data, readings=off))
        return TreeResiduals(erring, parameters).residuals(x)

    about = TreeResiduals(observations, parameters, joint_errors=errors)
    linear = about.linear(x)
    assert linear.r + linear.pulled == pytest.approx(shown(x, errors))
    pulled = np.sum(linear.by_joint * errors[observations.sample], axis=1)
    assert linear.pulled == pytest.approx(pulled)
    assert about.residuals(x) == pytest.approx(TreeResiduals(observations, parameters).residuals(x))
    for i, name in enumerate(parameters.names):
        step = np.zeros(len(x))
        step[i] = 1e-6 * max(1.0, abs(x[i]) / 100.0)
        slope = (shown(x + step, errors) - shown(x - step, errors)) / (2.0 * step[i])
        assert linear.J[i] == pytest.approx(slope, abs=2e-6 * (1.0 + np.abs(slope).max())), name
    for m in np.flatnonzero(read):
        step = np.zeros_like(errors)
        step[:, m] = 1e-6
        slope = (shown(x, errors + step) - shown(x, errors - step)) / 2e-6
        assert linear.by_joint[:, m] == pytest.approx(slope, abs=2e-6 * (1.0 + np.abs(slope).max()))


@pytest.mark.parametrize("which", slow_rest(["mirrored", "scene", "touched"]))
def test_small_changes_are_retold_from_the_frames_that_values_lead_to(which, request):
    _, parameters, x = request.getfixturevalue(which)
    there = TreeParameters(parameters.tree_of(x))
    x = parameters.values_of(there.base)  # turns of less than half a circle
    T = parameters.retold(x, parameters.names)
    for i, name in enumerate(parameters.names):
        step = 1e-6 * np.eye(len(x))[i]
        ends = [there.values_of(parameters.tree_of(x + s)) for s in (step, -step)]
        assert T[:, i] == pytest.approx((ends[0] - ends[1]) / 2e-6, abs=1e-7), name
    line = [f"a.{part}" for part in ("rx", "ry", "x", "y")]
    assert parameters.retold(x, line).tolist() == np.eye(4).tolist()
