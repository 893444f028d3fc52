"""A learned body as a plant: any tree of joints moves as the body does, whatever the numbers."""

from dataclasses import replace

import numpy as np
import pytest
from pydrake.autodiffutils import ExtractGradient, ExtractValue, InitializeAutoDiff
from pydrake.math import RigidTransform
from pydrake.multibody.inverse_kinematics import InverseKinematics
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import FixedOffsetFrame
from pydrake.solvers import Solve

from nico_selfmodel.errors import ModelError
from nico_selfmodel.geometry.rotation import rotation_from_vector
from nico_selfmodel.geometry.transform import transform
from nico_selfmodel.model.arm.bending import PARTS, Bending
from nico_selfmodel.model.tree.body_model import BodyModel
from nico_selfmodel.model.tree.body_tree import Attached, BodyTree
from nico_selfmodel.model.tree.tree_motion import TreeMotion
from nico_selfmodel.plant import BodyPlant

MOTIONS = {
    "serial": ("revolute",) * 4,
    "torso": ("revolute", "prismatic", "revolute", "revolute", "revolute", "prismatic"),
    "flange": ("flange", "revolute", "revolute"),
}
PARENTS = {"serial": (-1, 0, 1, 2), "torso": (-1, 0, 1, 1, 3, 4), "flange": (-1, 0, -1)}


def pose(rng):
    return transform(rotation_from_vector(rng.normal(size=3)), rng.uniform(-0.4, 0.4, 3))


def body(kind, seed=0, identities=False):
    """Return a body with a marker and a camera on each link and on the world, and a follower."""
    rng = np.random.default_rng(seed)
    motions, n = MOTIONS[kind], len(MOTIONS[kind])
    frames = np.array([np.eye(4) if identities else pose(rng) for _ in motions])
    coupling = np.eye(n)
    coupling[-1, -1], coupling[-1, 1] = 0.0, -0.5
    markers = tuple(Attached(f"ball{i}", i, pose(rng)) for i in range(-1, n))
    sensors = tuple(Attached(f"camera{i}", i, pose(rng)) for i in range(-1, n))
    tree = BodyTree(
        tuple(f"joint{i}" for i in range(n)), motions, np.array(PARENTS[kind]), frames,
        rng.uniform(0.8, 1.6, n), coupling, markers, sensors,
    )  # fmt: skip
    return BodyModel(f"body {seed}", tree, np.ones(n))


def read(model, seed=1):
    """Return readings and flanges of a pose."""
    rng = np.random.default_rng(seed)
    n = len(model.tree.joints)
    return rng.uniform(-1.0, 1.0, n), np.array([pose(rng) for _ in range(n)])


def assert_moves(robot, context, model, X_WP=None):
    """Compare every marker and sensor with the body, to 1e-9 m."""
    for seed in range(3):
        readings, flanges = read(model, seed)
        robot.set_readings(context, readings, flanges, model)
        motion = TreeMotion.at(model.tree, readings[None], flanges[None])
        for item in (*model.tree.markers, *model.tree.sensors):
            X = robot.frame(item.name).CalcPoseInWorld(robot.own_context(context))
            R, p = (part[..., 0] for part in motion.pose_of(item))
            expected = (RigidTransform() if X_WP is None else X_WP).GetAsMatrix4() @ transform(R, p)
            matrix = X.GetAsMatrix4()
            found = ExtractValue(matrix).reshape(4, 4) if matrix.dtype == object else matrix
            np.testing.assert_allclose(found, expected, atol=1e-9)


@pytest.mark.parametrize("time_step", [0.0, 1e-3])
@pytest.mark.parametrize("kind", MOTIONS)
def test_any_tree_moves_in_a_plant_as_the_body_does(kind, time_step):
    plant = MultibodyPlant(time_step)
    model, other = body(kind), body(kind, seed=3)
    beside = FixedOffsetFrame("beside", plant.world_frame(), RigidTransform([0.0, 1.0, 0.3]))
    robot = BodyPlant.add_to(plant, model, name="first")
    second = BodyPlant.add_to(plant, other, frame=plant.AddFrame(beside))
    plant.Finalize()
    contexts = [plant.CreateDefaultContext() for _ in range(2)]
    robot.write(contexts[0], other)
    assert_moves(robot, contexts[0], other)
    assert_moves(robot, contexts[1], model)
    assert_moves(second, contexts[0], other, RigidTransform([0.0, 1.0, 0.3]))


@pytest.mark.parametrize("identities", [False, True])
@pytest.mark.parametrize("kind", MOTIONS)
def test_a_converted_tree_moves_likewise_and_its_derivatives_are_right(kind, identities):
    plant = MultibodyPlant(1e-3)
    model, other = body(kind, identities=identities), body(kind, 4, identities)
    robot = BodyPlant.add_to(plant, model)
    plant.Finalize()
    converted = robot.in_plant(plant.ToAutoDiffXd())
    context = converted.plant.CreateDefaultContext()
    assert_moves(converted, context, model)
    converted.write(context, other)
    assert_moves(converted, context, other)
    readings, flanges = read(other)
    converted.set_readings(context, InitializeAutoDiff(readings).ravel(), flanges, other)
    step, by_reading = 1e-6 * np.eye(len(readings)), {}
    for item in other.tree.markers:
        same = np.repeat(flanges[None], len(step), 0)
        ends = [TreeMotion.at(other.tree, readings + sign * step, same) for sign in (1.0, -1.0)]
        by_reading[item.name] = (ends[0].pose_of(item)[1] - ends[1].pose_of(item)[1]) / 2e-6
        p = converted.frame(item.name).CalcPoseInWorld(context).translation()
        gradient = ExtractGradient(p)
        gradient = gradient if gradient.size else np.zeros((3, len(readings)))
        np.testing.assert_allclose(gradient, by_reading[item.name], atol=1e-8)
    assert max(np.abs(slope).max() for slope in by_reading.values()) > 0.1


def test_derivatives_by_a_pose_that_is_written_do_not_vanish_where_it_is_the_identity():
    plant = MultibodyPlant(0.0)
    robot = BodyPlant.add_to(plant, body("torso", identities=True))
    plant.Finalize()
    converted = robot.in_plant(plant.ToAutoDiffXd())
    context = converted.plant.CreateDefaultContext()
    pose = np.eye(4, dtype=object)
    pose[:3, 3] = InitializeAutoDiff(np.zeros(3)).ravel()
    frame = converted.plant.GetFrameByName("joint0_F", converted.instance)
    converted.write_poses(context, [(frame, pose)])
    p = converted.frame("ball0").CalcPoseInWorld(context).translation()
    assert ExtractGradient(p) == pytest.approx(np.eye(3))


@pytest.mark.parametrize(("time_step", "couplers"), [(1e-3, 1), (0.0, 0)])
def test_joints_keep_their_limits_and_what_follows_one_is_coupled_to_it(time_step, couplers):
    model = body("torso")
    n = len(model.tree.joints)
    limits = np.array([np.linspace(-1.0, -0.5, n), np.linspace(0.4, 2.0, n)])
    limits[:, -1] = [-np.inf, np.inf]
    model = replace(model, limits=limits)
    plant = MultibodyPlant(time_step)
    robot = BodyPlant.add_to(plant, model)
    plant.Finalize()
    for i, name in enumerate(model.tree.joints):
        joint = plant.GetJointByName(name, robot.instance)
        assert [*joint.position_lower_limits(), *joint.position_upper_limits()] == pytest.approx(
            [*model.reach[:, i]]
        )
    assert plant.num_constraints() == couplers
    if not couplers:
        return
    problem = InverseKinematics(plant)
    high = model.reach[1]
    goal = np.where(np.isfinite(high), high + 1.0, 0.0)
    problem.prog().AddQuadraticErrorCost(np.eye(n), goal, problem.q())
    found = Solve(problem.prog(), np.zeros(n)).GetSolution(problem.q())
    assert (found[:-1] <= high[:-1] + 1e-6).all()
    assert found[-1] == pytest.approx(-0.5 * found[1], abs=1e-6)


def test_what_does_not_fit_a_body_in_a_plant_is_refused():
    plant = MultibodyPlant(1e-3)
    model = body("torso")
    robot = BodyPlant.add_to(plant, model)
    with pytest.raises(ModelError, match="has a model 'body 0' already"):
        BodyPlant.add_to(plant, model)
    plant.Finalize()
    with pytest.raises(ModelError, match="is finalized already"):
        BodyPlant.add_to(plant, model, name="late")
    context = plant.CreateDefaultContext()
    strange = model.tree.with_markers((Attached("nose", 2), *model.tree.markers[1:]))
    with pytest.raises(ModelError, match=r"'body 0' is not the one in the plant: .* ball-1, nose"):
        robot.write(context, replace(model, tree=strange))
    with pytest.raises(ModelError, match=r"they differ in .*ball3"):
        robot.write(context, body("flange"))
    with pytest.raises(ValueError, match="no marker or sensor 'nose'; there are ball-1"):
        robot.frame("nose")
    with pytest.raises(ValueError, match=r"readings must have shape \(6,\), got \(2,\)"):
        robot.set_readings(context, [0.0, 1.0])
    for bad in (np.nan, np.inf):
        with pytest.raises(ValueError, match=f"'joint1' must go to a finite position, got {bad}"):
            robot.set_readings(context, [0.0, bad, 0.0, 0.0, 0.0, 0.0])
    with pytest.raises(TypeError, match="BodyModel is expected, got a BodyTree: give a body"):
        BodyPlant.add_to(MultibodyPlant(0.0), model.tree)
    named = model.tree.with_markers((Attached("joint1_F", 2), *model.tree.markers[1:]))
    with pytest.raises(ModelError, match="two frames of the body would be called 'joint1_F'"):
        BodyPlant.add_to(other := MultibodyPlant(0.0), replace(model, tree=named))
    assert other.num_model_instances() == 2
    on_a_flange = MultibodyPlant(0.0)
    robot = BodyPlant.add_to(on_a_flange, body("flange"))
    on_a_flange.Finalize()
    with pytest.raises(ValueError, match="joint 'joint0' is a flange: give flanges"):
        robot.set_readings(on_a_flange.CreateDefaultContext(), np.zeros(3))
    nowhere = np.full((3, 4, 4), np.nan)
    with pytest.raises(ValueError, match="joint 'joint0' is a flange: its pose must be finite"):
        robot.set_readings(on_a_flange.CreateDefaultContext(), np.zeros(3), nowhere)


def bent(model, seed=9):
    """The same body, which gives way by degrees."""
    rng = np.random.default_rng(seed)
    tree, n = model.tree, len(model.tree.joints)
    loads, pivots = 0.3 * rng.normal(size=(n, 3)), 0.2 * rng.normal(size=n)
    still = Bending.none(tree.joints, np.eye(3)[2], loads, pivots).with_effects(*PARTS)
    size = np.where(
        [name.split(".")[1].startswith(("load", "pivot")) for name in still.names], 0, 1
    )
    values = still.values + 0.05 * size * rng.normal(size=len(still.names))
    return replace(model, tree=replace(tree, bending=still.with_values(values)))


@pytest.mark.parametrize("kind", MOTIONS)
def test_a_body_that_bends_does_so_in_a_plant_and_its_derivatives_know(kind):
    plant = MultibodyPlant(1e-3)
    model = bent(body(kind))
    robot = BodyPlant.add_to(plant, model)
    plant.Finalize()
    context = plant.CreateDefaultContext()
    assert_moves(robot, context, model)
    converted = robot.in_plant(plant.ToAutoDiffXd())
    context = converted.plant.CreateDefaultContext()
    readings, flanges = read(model)
    converted.set_readings(context, InitializeAutoDiff(readings).ravel(), flanges, model)
    step = 1e-6 * np.eye(len(readings))
    same = np.repeat(flanges[None], len(step), 0)
    ends = [TreeMotion.at(model.tree, readings + sign * step, same) for sign in (1.0, -1.0)]
    for item in model.tree.markers:
        p = converted.frame(item.name).CalcPoseInWorld(context).translation()
        slope = (ends[0].pose_of(item)[1] - ends[1].pose_of(item)[1]) / 2e-6
        gradient = ExtractGradient(p)
        gradient = gradient if gradient.size else np.zeros(slope.shape)
        np.testing.assert_allclose(gradient, slope, atol=1e-7)
    rigid = replace(model, tree=replace(model.tree, bending=None))
    robot_now, other = TreeMotion.at(model.tree, readings[None], flanges[None]), rigid.tree
    still = TreeMotion.at(other, readings[None], flanges[None])
    moved = [robot_now.pose_of(m)[1] - still.pose_of(m)[1] for m in model.tree.markers]
    if "revolute" in model.tree.motions:
        assert max(np.linalg.norm(d) for d in moved) > 1e-3
