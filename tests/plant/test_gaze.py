"""A head turns so that a point comes to the middle of its images, or says that it cannot."""

from dataclasses import replace

import numpy as np
import pytest
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import ConstantVectorSource

from nico_selfmodel.errors import ModelError
from nico_selfmodel.model.arm.bending import Bending
from nico_selfmodel.model.tree.body_model import load_body, save_body
from nico_selfmodel.model.tree.body_tree import WORLD, Attached
from nico_selfmodel.plant.looking.gaze import WITHIN_PX, GazeSolver
from nico_selfmodel.systems.looking import HEAD_JOINTS, looking_body
from nico_selfmodel.systems.nico_cameras import NICO_CAMERAS
from nico_selfmodel.systems.simulated.imperfections import IMPERFECTIONS
from nico_selfmodel.systems.stations.nico_station import NicoStation
from nico_selfmodel.systems.stations.whole_nico import WholeNico
from nico_selfmodel.systems.tracking.gaze_controller import GazeController

from ..slow_rest import slow_rest
from ..true_nico import known_exactly

HEAD = np.array([0.07, 0.0, 0.45])


def model_of(seed):
    """A body that knows itself exactly, read in the counts of its own encoders."""
    nico = WholeNico.build(looking_body(), IMPERFECTIONS["thesis"], seed, NICO_CAMERAS)
    return known_exactly(nico.mechanics, nico.mechanics.tree), nico


def points_before(rng, count):
    away, side, up = rng.uniform([0.2, -1.1, -0.6], [1.5, 1.1, 0.4], (count, 3)).T
    way = [np.cos(up) * np.cos(side), np.cos(up) * np.sin(side), np.sin(up)]
    return HEAD + away[:, None] * np.stack(way, axis=1)


def resting(model):
    return model.limits.mean(axis=0)


@pytest.mark.parametrize("seed", slow_rest([0, 1]))
def test_points_before_the_head_come_to_the_middle_of_both_true_images(seed):
    model, nico = model_of(seed)
    solver, rng = GazeSolver(model), np.random.default_rng(seed)
    assert set(solver.joints) == set(HEAD_JOINTS)
    off = []
    for p in points_before(rng, 25):
        found = solver.at_point(rng.uniform(*model.limits), p)
        assert (found.readings >= model.limits[0]).all()
        assert (found.readings <= model.limits[1]).all()
        X_BL, rig = nico.mechanics.cameras(nico.mechanics.servos.to_joint(found.readings))
        p_L = X_BL[:3, :3].T @ (p - X_BL[:3, 3])
        u = rig.project(p_L[None])[0].reshape(2, 2) - [319.5, 239.5]
        assert np.linalg.norm(u, axis=1).max() == pytest.approx(found.off_px, abs=1e-6)
        off.append(found.off_px - found.misaligned_px)
    assert np.mean(np.array(off) <= WITHIN_PX) >= 0.95


def test_only_the_head_turns_and_the_hand_is_looked_at_where_the_arm_has_it():
    model, nico = model_of(0)
    solver = GazeSolver(model)
    q = np.zeros(18)
    names = list(nico.body.joints)
    q[names.index("left_shoulder_pitch")], q[names.index("left_elbow")] = -0.8, -0.9
    now = nico.mechanics.servos.to_encoder(q)
    found = solver.at_point(now, solver.place_of(now, "left_hand_fiducial"))
    arms = [i for i, name in enumerate(names) if name not in HEAD_JOINTS]
    assert np.array_equal(found.readings[arms], now[arms])
    assert found.off_px - found.misaligned_px <= WITHIN_PX


@pytest.mark.parametrize(
    "point", [[-0.5, 0.0, 0.45], [0.0, 0.0, 2.0], [0.03, 0.0, 0.48]],
    ids=["behind", "overhead", "inside the head"],
)  # fmt: skip
def test_what_cannot_be_seen_is_out_of_reach(point):
    model, _ = model_of(0)
    with pytest.raises(ModelError, match="out of reach: the point"):
        GazeSolver(model).at_point(resting(model), point)


def test_a_head_that_sags_looks_there_all_the_same():
    model, _ = model_of(0)
    tree, n = model.tree, 18
    sag = np.zeros(n)
    sag[1] = 0.3
    loads = np.tile([0.1, 0.0, 0.0], (n, 1))
    rigid = Bending.none(tree.joints, np.array([0.0, 0.0, 1.0]), loads, np.zeros(n))
    bends = replace(rigid.with_effects("sag"), sag=sag)
    bent = replace(model, tree=replace(tree, bending=bends))
    straight = GazeSolver(model).at_point(resting(model), [0.6, 0.1, 0.4])
    found = GazeSolver(bent).at_point(resting(model), [0.6, 0.1, 0.4])
    assert found.off_px == pytest.approx(straight.off_px, abs=1.0)
    assert np.abs(found.readings - straight.readings)[1] > 20.0


def test_bodies_that_cannot_look_say_so():
    model, _ = model_of(0)
    tree = model.tree
    fixed = replace(model, tree=replace(tree, sensors=tuple(
        replace(s, on=WORLD) for s in tree.sensors)))  # fmt: skip
    with pytest.raises(ModelError, match="no joint of this body turns a camera"):
        GazeSolver(fixed)
    with pytest.raises(ModelError, match=r"third.*there are left_wide_camera"):
        GazeSolver(model, ["third"])
    nose = tree.with_markers((*tree.markers, Attached("nose", 3)))
    with pytest.raises(ModelError, match="'nose' moves with neck_yaw"):
        GazeSolver(replace(model, tree=nose)).place_of(resting(model), "nose")
    with pytest.raises(ValueError, match="3 finite coordinates"):
        GazeSolver(model).at_point(resting(model), [0.0, np.nan, 0.0])
    with pytest.raises(ValueError, match=r"shape \(18,\)"):
        GazeSolver(model).at_point(np.zeros(4), [1.0, 0.0, 0.0])


def test_limits_are_kept_in_the_bodys_file(tmp_path):
    model, _ = model_of(0)
    unlimited = np.array(model.limits)
    unlimited[:, 3] = -np.inf, np.inf
    save_body(replace(model, limits=unlimited), tmp_path / "body.yaml")
    assert np.array_equal(load_body(tmp_path / "body.yaml").limits, unlimited)


def test_the_system_commands_the_head_alone_and_stops_it_where_nothing_is_in_reach():
    model, _ = model_of(0)
    system = GazeController(model)
    simulator = Simulator(system)
    context = simulator.get_mutable_context()
    system.GetInputPort("encoders").FixValue(context, resting(model))
    point = system.GetInputPort("p_WT")
    point.FixValue(context, [0.6, 0.2, 0.5])
    simulator.AdvanceTo(0.01)
    command = system.GetOutputPort("encoders_commanded").Eval(context)
    assert [i for i in range(18) if np.isfinite(command[i])] == list(range(6))
    expected = GazeSolver(model).at_point(resting(model), [0.6, 0.2, 0.5]).readings
    assert command[:6] == pytest.approx(expected[:6], abs=1e-3)
    assert system.GetOutputPort("looking").Eval(context).tolist() == [1.0]
    point.FixValue(context, [-0.6, 0.0, 0.5])
    simulator.AdvanceTo(0.15)
    assert np.isnan(system.GetOutputPort("encoders_commanded").Eval(context)).all()
    assert system.GetOutputPort("looking").Eval(context).tolist() == [0.0]


def test_the_system_follows_the_own_hand():
    model, nico = model_of(0)
    system = GazeController(model, marker="right_hand_fiducial")
    assert not system.HasInputPort("p_WT")
    q = np.zeros(18)
    names = list(nico.body.joints)
    q[names.index("right_shoulder_pitch")], q[names.index("right_elbow")] = -0.8, -0.9
    simulator = Simulator(system)
    context = simulator.get_mutable_context()
    system.GetInputPort("encoders").FixValue(context, nico.mechanics.servos.to_encoder(q))
    simulator.AdvanceTo(0.01)
    assert system.GetOutputPort("looking").Eval(context).tolist() == [1.0]


@pytest.mark.slow
def test_a_station_whose_head_is_driven_by_the_system_comes_to_look_at_the_point():
    model, nico = model_of(0)
    point, builder = np.array([0.6, 0.3, 0.4]), DiagramBuilder()
    station = builder.AddNamedSystem("nico", NicoStation("thesis", 0, arm=looking_body()))
    gaze = builder.AddNamedSystem("gaze", GazeController(model))
    here = builder.AddSystem(ConstantVectorSource(point))
    builder.Connect(station.GetOutputPort("encoders"), gaze.GetInputPort("encoders"))
    builder.Connect(here.get_output_port(), gaze.GetInputPort("p_WT"))
    wanted = gaze.GetOutputPort("encoders_commanded")
    builder.Connect(wanted, station.GetInputPort("encoders_commanded"))
    diagram = builder.Build()
    simulator = Simulator(diagram)
    simulator.AdvanceTo(2.5)
    context = station.GetMyContextFromRoot(simulator.get_context())
    readings = station.GetOutputPort("encoders").Eval(context)
    station.close()
    X_BL, rig = nico.mechanics.cameras(nico.mechanics.servos.to_joint(readings))
    off = rig.project((X_BL[:3, :3].T @ (point - X_BL[:3, 3]))[None])[0] - [319.5, 239.5] * 2
    found = GazeSolver(model).at_point(readings, point)
    assert np.abs(off).max() <= found.off_px + 1.0
    straight = nico.mechanics.servos.to_encoder(np.zeros(18))
    assert readings[6:] == pytest.approx(straight[6:], abs=1.0)
