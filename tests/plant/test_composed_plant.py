"""Learned arms in a plant of the user's own: beside others, converted, planned with, simulated."""

import numpy as np
import pytest
from pydrake.autodiffutils import AutoDiffXd, ExtractGradient, ExtractValue, InitializeAutoDiff
from pydrake.geometry import Box
from pydrake.math import RigidTransform, RigidTransform_, RollPitchYaw_, RotationMatrix_
from pydrake.multibody.inverse_kinematics import InverseKinematics
from pydrake.multibody.optimization import CalcGridPointsOptions, Toppra
from pydrake.multibody.plant import (
    AddMultibodyPlantSceneGraph,
    CoulombFriction,
    DiscreteContactApproximation,
    MultibodyPlant,
)
from pydrake.multibody.tree import FixedOffsetFrame, PrismaticJoint, SpatialInertia
from pydrake.solvers import Solve
from pydrake.symbolic import Expression, MakeVectorVariable
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder
from pydrake.trajectories import PiecewisePolynomial

from nico_selfmodel.errors import ModelError
from nico_selfmodel.plant import ArmDescription, SelfModelPlant

STEP = 1e-3


@pytest.fixture
def ur5(project_root):
    return ArmDescription.from_urdf(project_root / "examples" / "six_axis.urdf", tip_link="tool0")


@pytest.fixture
def learned(build_individual, learn):
    """Return a function that learns another individual of an arm."""
    return lambda arm, seed=1: learn(build_individual(arm.chain, seed))


@pytest.fixture
def own_diagram(ur5, describe, learned):
    """Return a plant of one's own with a table and two learned arms of different robots."""

    def build(time_step=STEP, **changes):
        builder = DiagramBuilder()
        plant, _ = AddMultibodyPlantSceneGraph(builder, MultibodyPlant(time_step))
        plant.set_discrete_contact_approximation(DiscreteContactApproximation.kSimilar)
        table = RigidTransform([0.0, 0.0, -0.2])
        plant.RegisterCollisionGeometry(
            plant.world_body(), table, Box(3.0, 3.0, 0.1), "table", CoulombFriction(0.8, 0.6)
        )
        side = FixedOffsetFrame("side", plant.world_frame(), RigidTransform([1.0, 0.0, 0.3]))
        nico = describe("right_arm")
        robots = (
            SelfModelPlant.add_to(plant, ur5, learned(ur5), name="ur", **changes),
            SelfModelPlant.add_to(plant, nico, learned(nico), frame=plant.AddFrame(side)),
        )
        plant.Finalize()
        return plant, builder.Build(), robots

    return build


def positions_of(robot, context, q, readings=None):
    """Return the tracked points in the frame that the robot was added to. Shape (m, 3)."""
    robot.set_joint_angles(context, q)
    own = robot.own_context(context)
    frames = [robot.tracked_point_frame(marker) for marker in robot.markers]
    return np.array([frame.CalcPoseInWorld(own).translation() for frame in frames])


def assert_predicts(robot, context, model, X_WM=None):
    """Compare the tracked points with `predict`, to 1e-9 m."""
    X_WM = RigidTransform() if X_WM is None else X_WM
    for q in np.random.default_rng(3).uniform(-2.0, 2.0, (3, len(model.joints))):
        readings = model.servos.to_encoder(q)
        points = positions_of(robot, context, q)
        for k, marker in enumerate(model.markers):
            p = X_WM @ model.predict(readings, marker).p_WH[0]
            value = np.ravel(ExtractValue(points[k])) if points.dtype == object else points[k]
            np.testing.assert_allclose(value, p, rtol=0, atol=1e-9)


def test_two_learned_arms_stand_beside_a_table_each_where_its_self_model_has_it(own_diagram):
    plant, diagram, (ur, nico) = own_diagram()
    assert plant.time_step() == STEP
    assert plant.get_discrete_contact_approximation() == DiscreteContactApproximation.kSimilar
    root = diagram.CreateDefaultContext()
    assert_predicts(ur, root, ur.model)
    assert_predicts(nico, root, nico.model, RigidTransform([1.0, 0.0, 0.3]))


def test_a_self_model_is_written_into_one_context_of_ones_own_diagram(own_diagram, learned):
    _, diagram, (ur, nico) = own_diagram()
    other = learned(ur.arm, seed=7)
    contexts = [diagram.CreateDefaultContext() for _ in range(2)]
    ur.write(contexts[0], other)
    assert_predicts(ur, contexts[0], other)
    assert_predicts(ur, contexts[1], ur.model)
    assert_predicts(nico, contexts[0], nico.model, RigidTransform([1.0, 0.0, 0.3]))


def test_what_hangs_in_the_plant_by_constraints_stays(describe, learned):
    plant = MultibodyPlant(STEP)
    bodies = [plant.AddRigidBody(n, SpatialInertia.SolidBoxWithMass(1, 1, 1, 1)) for n in "ab"]
    for body, axis in zip(bodies, np.eye(3), strict=False):
        joint = PrismaticJoint(body.name(), plant.world_frame(), body.body_frame(), axis)
        plant.AddJoint(joint)
    plant.AddCouplerConstraint(plant.GetJointByName("a"), plant.GetJointByName("b"), 2.0)
    arm = describe("six")
    robot = SelfModelPlant.add_to(plant, arm, learned(arm))
    plant.Finalize()
    assert len(plant.GetConstraintIds()) == 1
    assert_predicts(robot, plant.CreateDefaultContext(), robot.model)


@pytest.mark.parametrize("time_step", [0.0, STEP])
def test_the_converted_plant_predicts_and_so_do_its_derivatives(arm, learned, time_step):
    robot = SelfModelPlant.from_urdf(arm, learned(arm), time_step=time_step)
    other = learned(arm, seed=8)
    converted = robot.in_plant(robot.plant.ToAutoDiffXd())
    context = converted.plant.CreateDefaultContext()
    assert_predicts(converted, context, robot.model)
    converted.write(context, other)
    assert_predicts(converted, context, other)
    q, h = np.linspace(-0.4, 0.7, len(arm.joints)), 1e-6
    points = positions_of(converted, context, InitializeAutoDiff(q).ravel())
    for k, point in enumerate(points):
        steps = h * np.eye(len(q))
        by_q = [(other.chain.forward(q + s, k) - other.chain.forward(q - s, k)) for s in steps]
        np.testing.assert_allclose(ExtractGradient(point), np.array(by_q).T / (2 * h), atol=1e-8)


def test_readings_carry_their_derivatives_through_a_converted_plant_as_predict_does(ur5, learned):
    robot = SelfModelPlant.from_urdf(ur5, learned(ur5))
    converted = robot.in_plant(robot.plant.ToAutoDiffXd())
    context = converted.plant.CreateDefaultContext()
    readings = robot.model.servos.to_encoder(np.linspace(-0.4, 0.7, 6))
    seeded = InitializeAutoDiff(readings).ravel()
    converted.set_positions(context, seeded)
    p = converted.tracked_point_frame().CalcPoseInWorld(context).translation()
    steps = 1e-2 * np.eye(6)
    predict = robot.model.predict
    differences = [
        (predict(readings + s).p_WH[0] - predict(readings - s).p_WH[0]) / 2e-2 for s in steps
    ]
    np.testing.assert_allclose(ExtractGradient(p), np.array(differences).T, atol=1e-9)
    np.testing.assert_allclose(ExtractGradient(p), ExtractGradient(predict(seeded).p_WH[0]))


def test_a_symbolic_plant_holds_the_self_model_too(project_root, tmp_path, learned):
    # Symbolic plants of Drake 1.58 divide by the mass of every link: the flange needs one.
    mass = '<inertial><mass value="1e-3"/><inertia ixx="1e-6" iyy="1e-6" izz="1e-6" '
    mass += 'ixy="0" ixz="0" iyz="0"/></inertial>'
    plain = (project_root / "examples" / "six_axis.urdf").read_text()
    heavy = plain.replace('<link name="tool0"/>', f'<link name="tool0">{mass}</link>')
    assert heavy != plain
    (tmp_path / "heavy.urdf").write_text(heavy)
    arm = ArmDescription.from_urdf(tmp_path / "heavy.urdf", tip_link="tool0")
    robot = SelfModelPlant.from_urdf(arm, learned(arm))
    symbolic = robot.in_plant(robot.plant.ToSymbolic())
    context = symbolic.plant.CreateDefaultContext()
    other = learned(arm, seed=8)
    symbolic.write(context, other)
    q = MakeVectorVariable(6, "q")
    symbolic.set_joint_angles(context, np.array([Expression(variable) for variable in q]))
    p = symbolic.tracked_point_frame().CalcPoseInWorld(context).translation()
    values = np.linspace(-0.4, 0.7, 6)
    found = [x.Evaluate(dict(zip(q, values, strict=True))) for x in p]
    np.testing.assert_allclose(found, other.chain.forward(values), atol=1e-9)


ON_IDENTITIES = """<robot name="plain"><link name="a"/><link name="b"/><link name="c"/>
<joint name="one" type="continuous"><parent link="a"/><child link="b"/><axis xyz="0 0 1"/></joint>
<joint name="two" type="continuous"><parent link="b"/><child link="c"/><axis xyz="0 0 1"/></joint>
<frame name="hand" link="c" xyz="0.3 0.2 0"/></robot>"""


def test_derivatives_by_a_frame_do_not_vanish_where_its_pose_is_the_identity(tmp_path):
    path = tmp_path / "plain.urdf"
    path.write_text(ON_IDENTITIES)
    plain = ArmDescription.from_urdf(path, "a", "c", points={"hand": "hand"})
    robot = SelfModelPlant.from_urdf(plain)
    frames = [robot.plant.GetFrameByName(name) for name in ("one_F", "one_M", "two_F", "two_M")]
    context = robot.plant.CreateDefaultContext()
    poses = [frame.GetPoseInParentFrame(context) for frame in frames]
    assert any(pose.IsNearlyIdentity(1e-15) for pose in poses)
    converted = robot.in_plant(robot.plant.ToAutoDiffXd())
    hand = robot.tracked_point_frame()
    for frame, pose in zip(frames, poses, strict=True):
        by_pose = np.empty((3, 6))
        for column, step in enumerate(1e-6 * np.eye(6)):
            moved = []
            for sign in (1.0, -1.0):
                frame.SetPoseInParentFrame(context, pose @ small_pose(sign * step, float))
                moved.append(hand.CalcPoseInWorld(context).translation())
            by_pose[:, column] = (moved[0] - moved[1]) / 2e-6
        frame.SetPoseInParentFrame(context, pose)
        own = converted.plant.CreateDefaultContext()
        same = converted.plant.GetFrameByName(frame.name())
        seeds = InitializeAutoDiff(np.zeros(6)).ravel()
        X = same.GetPoseInParentFrame(own) @ small_pose(seeds, AutoDiffXd)
        same.SetPoseInParentFrame(own, X)
        p = converted.tracked_point_frame().CalcPoseInWorld(own).translation()
        np.testing.assert_allclose(ExtractGradient(p), by_pose, atol=1e-9)


def small_pose(x, T):
    return RigidTransform_[T](RotationMatrix_[T](RollPitchYaw_[T](x[:3])), x[3:])


def test_inverse_kinematics_reaches_where_the_self_model_predicts(own_diagram):
    plant, diagram, (ur, _) = own_diagram()
    root = diagram.CreateDefaultContext()
    wanted = np.array([0.3, -0.9, 1.1, 0.4, -0.5, 0.2])
    p_WH = ur.model.chain.forward(wanted)
    ik = InverseKinematics(plant, ur.own_context(root))
    ik.AddPositionConstraint(ur.tracked_point_frame(), np.zeros(3), plant.world_frame(), p_WH, p_WH)
    start = plant.GetPositions(ur.own_context(root))
    start[ur.columns] = wanted + 0.2
    result = Solve(ik.prog(), start)
    assert result.is_success()
    q = result.GetSolution(ik.q())[ur.columns]
    np.testing.assert_allclose(ur.model.chain.forward(q), p_WH, atol=1e-5)
    assert np.abs(q - wanted).max() > 1e-3


def test_toppra_keeps_the_learned_hand_below_its_speed(own_diagram):
    plant, _, (ur, _) = own_diagram()
    n = plant.num_positions()
    knots = np.zeros((n, 4))
    knots[ur.columns] = np.random.default_rng(2).uniform(-0.8, 0.8, (6, 4))
    path = PiecewisePolynomial.CubicShapePreserving(np.arange(4.0), knots)
    toppra = Toppra(path, plant, Toppra.CalcGridPoints(path, CalcGridPointsOptions()))
    toppra.AddJointVelocityLimit(-2.0 * np.ones(n), 2.0 * np.ones(n))
    toppra.AddJointAccelerationLimit(-5.0 * np.ones(n), 5.0 * np.ones(n))
    toppra.AddFrameTranslationalSpeedLimit(ur.tracked_point_frame(), 0.25)
    timing = toppra.SolvePathParameterization()
    assert timing is not None
    times = np.linspace(0.0, timing.end_time(), 200)
    q = np.array([path.value(timing.value(t)[0, 0])[ur.columns, 0] for t in times])
    hand = ur.model.chain.forward(q)
    speed = np.linalg.norm(np.diff(hand, axis=0), axis=1) / np.diff(times)
    assert 0.2 < speed.max() < 0.26


@pytest.mark.slow
def test_arms_fall_onto_the_table_in_time(own_diagram):
    plant, diagram, (ur, _) = own_diagram()
    simulator = Simulator(diagram)
    context = plant.GetMyMutableContextFromRoot(simulator.get_mutable_context())
    plant.get_actuation_input_port().FixValue(context, np.zeros(plant.num_actuators()))
    simulator.AdvanceTo(0.3)
    assert simulator.get_num_steps_taken() == pytest.approx(300, abs=1)
    q = plant.GetPositions(context)
    assert np.isfinite(q).all()
    assert np.abs(q[ur.columns]).max() > 0.05


MIMICKED = """<robot name="r"><link name="a"/><link name="b"/><link name="c"/><link name="d"/>
<joint name="one" type="continuous"><parent link="a"/><child link="b"/><axis xyz="0 0 1"/></joint>
<joint name="two" type="revolute"><parent link="b"/><child link="c"/><axis xyz="0 1 0"/>
  <limit lower="-1" upper="1" effort="1" velocity="1"/></joint>
<joint name="three" type="revolute"><parent link="b"/><child link="d"/><axis xyz="0 1 0"/>
  <limit lower="-1" upper="1" effort="1" velocity="1"/>
  <mimic joint="two" multiplier="-2" offset="0.1"/></joint></robot>"""


@pytest.mark.parametrize(("time_step", "couplers"), [(STEP, 1), (0.0, 0)])
def test_joints_that_mimic_others_go_on_doing_so_where_drake_can(tmp_path, time_step, couplers):
    path = tmp_path / "r.urdf"
    path.write_text(MIMICKED)
    arm = ArmDescription.from_urdf(path, "a", "b")
    plant = SelfModelPlant.from_urdf(arm, time_step=time_step).plant
    assert len(plant.GetConstraintIds()) == couplers


def test_what_cannot_be_added_is_refused_in_one_line_and_leaves_the_plant(
    own_diagram, ur5, describe, learned
):
    finished, _, _ = own_diagram()
    with pytest.raises(ModelError, match=r"is finalized already: add the self-model before Final"):
        SelfModelPlant.add_to(finished, ur5)
    plant = MultibodyPlant(STEP)
    SelfModelPlant.add_to(plant, ur5, name="ur")
    before = plant.num_frames(), plant.num_joints(), plant.num_model_instances()
    with pytest.raises(ModelError, match="the plant has a model 'ur' already: give this one anoth"):
        SelfModelPlant.add_to(plant, ur5, name="ur")
    with pytest.raises(ModelError, match="the self-model has the joints neck_yaw"):
        SelfModelPlant.add_to(plant, ur5, learned(describe("neck")))
    with pytest.raises(ModelError, match="frame 'world' belongs to another plant"):
        SelfModelPlant.add_to(plant, ur5, name="b", frame=finished.world_frame())
    assert (plant.num_frames(), plant.num_joints(), plant.num_model_instances()) == before
    robot = SelfModelPlant.from_urdf(ur5, learned(ur5))
    converted = robot.plant.ToAutoDiffXd()
    with pytest.raises(ValueError, match=r"take the robot by in_plant\(plant\)"):
        robot.write(converted.CreateDefaultContext(), robot.model)
    with pytest.raises(ModelError, match="the plant has no model 'six_axis'"):
        robot.in_plant(MultibodyPlant(STEP))
