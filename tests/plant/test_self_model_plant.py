import numpy as np
import pytest
from pydrake.geometry import SceneGraph
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import FixedOffsetFrame, RevoluteJoint
from pydrake.systems.framework import DiagramBuilder

from nico_selfmodel.errors import ModelError
from nico_selfmodel.plant import ArmDescription, SelfModelPlant
from nico_selfmodel.plant.frames import frame_names

POSES = 4


def assert_points_agree(robot, context, model, seed=0):
    """Compare every tracked point in the world with the self-model's chain, to 1e-12."""
    world = robot.plant.world_frame()
    for q in np.random.default_rng(seed).uniform(-3.0, 3.0, (POSES, len(model.joints))):
        robot.set_joint_angles(context, q)
        for k, marker in enumerate(model.markers):
            frame = robot.tracked_point_frame(marker)
            X_WH = robot.plant.CalcRelativeTransform(robot.own_context(context), world, frame)
            np.testing.assert_allclose(
                X_WH.translation(), model.chain.forward(q, k), rtol=0, atol=1e-12
            )


@pytest.mark.parametrize("size", [0.02, 0.3])
def test_a_plant_built_with_a_self_model_moves_as_the_chain_does(
    arm, build_individual, learn, size
):
    model = learn(build_individual(arm.chain, seed=3, size=size))
    robot = SelfModelPlant.from_urdf(arm, model)
    assert_points_agree(robot, robot.plant.CreateDefaultContext(), model)


def test_a_self_model_written_into_a_context_moves_it_and_no_other(arm, build_individual, learn):
    robot = SelfModelPlant.from_urdf(arm)
    models = [learn(build_individual(arm.chain, seed)) for seed in (4, 5)]
    contexts = [robot.plant.CreateDefaultContext() for _ in models]
    for context, model in zip(contexts, models, strict=True):
        robot.write(context, model)
    for context, model in zip(contexts, models, strict=True):
        assert_points_agree(robot, context, model)
    robot.write(contexts[0], models[1])
    assert_points_agree(robot, contexts[0], models[1])


def test_without_a_self_model_the_robot_stands_at_the_origin_as_described(arm):
    robot = SelfModelPlant.from_urdf(arm)
    context = robot.plant.CreateDefaultContext()
    X_RB = np.linalg.inv(arm.links.X_BR)
    q = np.linspace(-0.5, 0.8, len(arm.joints))
    robot.set_joint_angles(context, q)
    p = robot.tracked_point_frame().CalcPoseInWorld(context).translation()
    expected = X_RB[:3, :3] @ arm.chain.forward(q) + X_RB[:3, 3]
    np.testing.assert_allclose(p, expected, rtol=0, atol=1e-12)


def test_links_beside_the_learned_chain_stay_where_they_were_on_their_links(describe, learn):
    arm = describe("six")
    robot = SelfModelPlant.from_urdf(arm, learn(arm.chain))
    plain = MultibodyPlant(0.0)
    Parser(plain).AddModels(str(arm.urdf))
    plain.Finalize()
    poses = []
    for plant in (robot.plant, plain):
        context = plant.CreateDefaultContext()
        for joint, angle in [("joint2", 0.4), ("joint6", -0.7), ("curl", 0.5)]:
            plant.GetJointByName(joint).set_angle(context, angle)
        plant.GetJointByName("slide").set_translation(context, 0.05)
        frames = [plant.GetFrameByName(name) for name in ("base", "finger")]
        poses.append(plant.CalcRelativeTransform(context, *frames).GetAsMatrix4())
    np.testing.assert_allclose(poses[0], poses[1], atol=1e-12)


def test_every_revolute_joint_stands_on_two_frames_of_ours_with_z_as_its_axis(arm):
    plant = SelfModelPlant.from_urdf(arm).plant
    joints = [plant.get_joint(index) for index in plant.GetJointIndices()]
    revolute = [joint for joint in joints if isinstance(joint, RevoluteJoint)]
    assert {joint.name() for joint in revolute} >= set(arm.joints)
    for joint in revolute:
        for frame in (joint.frame_on_parent(), joint.frame_on_child()):
            assert isinstance(frame, FixedOffsetFrame)
            assert frame.name() in (f"{joint.name()}_F", f"{joint.name()}_M")
        np.testing.assert_array_equal(joint.revolute_axis(), [0.0, 0.0, 1.0])


def test_limits_damping_and_motors_outlive_the_new_joints(arm):
    ours = SelfModelPlant.from_urdf(arm).plant
    plain = MultibodyPlant(0.0)
    Parser(plain).AddModels(str(arm.urdf))
    plain.Finalize()
    assert ours.num_positions() == plain.num_positions() - 7 * (arm.links.root_link != "world")
    for index in plain.GetJointIndices():
        old = plain.get_joint(index)
        if not isinstance(old, RevoluteJoint):
            continue
        new = ours.GetJointByName(old.name())
        for value in ("position", "velocity", "acceleration"):
            for side in ("lower", "upper"):
                name = f"{value}_{side}_limit"
                assert getattr(new, name)() == getattr(old, name)()
        assert new.default_damping() == old.default_damping()
    assert ours.num_actuators() == plain.num_actuators() > 0
    for index in plain.GetJointActuatorIndices():
        old = plain.get_joint_actuator(index)
        new = ours.GetJointActuatorByName(old.name())
        assert new.joint().name() == old.joint().name()
        assert new.effort_limit() == old.effort_limit()


def test_a_hand_on_the_last_axis_does_not_turn_the_last_link_by_chance(describe, learn):
    arm = describe("on_axis")
    # 0.1 mm off the axis, in the direction opposite to the first common normal.
    for push in np.vstack([np.eye(3), -np.eye(3)]) * 1e-4:
        chain = arm.chain.moved(np.eye(4))
        shifted = type(chain)(
            chain.joints, chain.directions, chain.points, chain.markers, chain.p_WH_zero + push
        )
        robot = SelfModelPlant.from_urdf(arm, learn(shifted))
        context = robot.plant.CreateDefaultContext()
        X_WT = robot.plant.GetFrameByName("tip").CalcPoseInWorld(context).rotation().matrix()
        np.testing.assert_allclose(X_WT, arm.links.X_BT[:3, :3], atol=1e-3)
        assert_points_agree(robot, context, learn(shifted))


def test_readings_move_the_learned_joints_and_leave_the_others(describe, learn, build_individual):
    arm = describe("right_arm")
    model = learn(build_individual(arm.chain, 6))
    robot = SelfModelPlant.from_urdf(arm, model)
    context = robot.plant.CreateDefaultContext()
    robot.plant.GetJointByName("torso_yaw").set_angle(context, 0.2)
    readings = np.array([100.0, -800.0, 300.0, 900.0])
    robot.set_positions(context, readings)
    q = model.servos.to_joint(readings)
    angles = [robot.plant.GetJointByName(name).get_angle(context) for name in arm.joints]
    np.testing.assert_array_equal(angles, q)
    assert robot.plant.GetJointByName("torso_yaw").get_angle(context) == 0.2
    positions = robot.plant.GetPositions(context)
    np.testing.assert_array_equal(positions[robot.columns], q)
    assert np.count_nonzero(positions) == len(arm.joints) + 1  # and the torso's


@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_what_drake_would_end_the_process_over_is_an_error_of_one_line(describe, learn, bad):
    arm = describe("six")
    model = learn(arm.chain)
    robot = SelfModelPlant.from_urdf(arm, model)
    context, q = robot.plant.CreateDefaultContext(), np.zeros(6)
    before = robot.plant.GetPositions(context)
    q[2] = bad
    for move in (robot.set_positions, robot.set_joint_angles):
        with pytest.raises(ValueError, match=f"joint {arm.joints[2]!r} must go to a finite"):
            move(context, q)
    with pytest.raises(ValueError, match="context belongs to another plant"):
        robot.set_joint_angles(None, np.zeros(6))
    np.testing.assert_array_equal(robot.plant.GetPositions(context), before)
    with pytest.raises(ModelError, match="call it on the plant first"):
        assert SelfModelPlant.add_to(MultibodyPlant(0.0), arm, model).columns is None


def test_held_joints_start_at_their_values(describe):
    robot = SelfModelPlant.from_urdf(describe("six"))
    assert robot.plant.GetJointByName("slide").default_positions() == [0.05]


def test_a_plant_made_here_is_discrete_unless_asked_otherwise(describe):
    arm = describe("right_arm")
    assert SelfModelPlant.from_urdf(arm).plant.time_step() == 1e-3
    assert SelfModelPlant.from_urdf(arm, time_step=0.0).plant.time_step() == 0.0


def test_a_builder_gets_the_geometry_and_a_root_context_will_do(describe, learn, build_individual):
    arm, builder = describe("left_arm"), DiagramBuilder()
    robot = SelfModelPlant.from_urdf(arm, builder=builder)
    assert isinstance(robot.scene_graph, SceneGraph)
    assert robot.scene_graph.model_inspector().num_geometries() > 50
    root = builder.Build().CreateDefaultContext()
    model = learn(build_individual(arm.chain, 8))
    robot.write(root, model)
    assert_points_agree(robot, root, model)


def test_a_mesh_that_is_not_there_is_an_error_only_where_it_would_be_drawn(tmp_path, urdf_text):
    path = tmp_path / "six.urdf"
    path.write_text(urdf_text("six", mesh="nowhere.obj"))
    arm = ArmDescription.from_urdf(path, tip_link="tip", held={"slide": 0.0})
    assert SelfModelPlant.from_urdf(arm).scene_graph is None
    with pytest.raises(ModelError, match=r"nowhere\.obj"):
        SelfModelPlant.from_urdf(arm, builder=DiagramBuilder())


def test_a_point_the_robot_does_not_know_stands_for_its_first_one(describe, learn):
    arm = describe("right_arm")
    chain = arm.chain
    renamed = type(chain)(
        chain.joints, chain.directions, chain.points, ("ball", "thumb"),
        np.vstack([chain.p_WH_zero, chain.p_WH_zero + 0.01]),
    )  # fmt: skip
    robot = SelfModelPlant.from_urdf(arm, learn(renamed))
    assert robot.markers == ("ball", "thumb")
    assert_points_agree(robot, robot.plant.CreateDefaultContext(), learn(renamed))


ON_THE_WORLD = """<robot name="r"><link name="world"/><link name="a"/><link name="b"/>
<link name="finger"/>{first}
<joint name="one" type="continuous"><parent link="a"/><child link="b"/>
  <origin xyz="0.1 0.2 0.3"/><axis xyz="0 1 0"/></joint>
<joint name="two" type="continuous"><parent link="b"/><child link="finger"/>
  <mimic joint="one" multiplier="2"/></joint></robot>"""
WELD = '<joint name="{0}" type="{1}"><parent link="world"/><child link="a"/>{2}</joint>'


@pytest.fixture
def on_the_world(tmp_path):
    def describe(kind: str, more: str = "") -> ArmDescription:
        path = tmp_path / "arm.urdf"
        first = WELD.format("mount", kind, '<origin xyz="0 0 1" rpy="0 0 1"/>') + more
        path.write_text(ON_THE_WORLD.format(first=first))
        return ArmDescription.from_urdf(path, "a", "b", points={"hand": "finger"}, held={"two": 0})

    return describe


def test_a_robot_that_its_file_fixes_to_the_world_is_moved_to_where_it_is(
    on_the_world, learn, build_individual
):
    arm = on_the_world("fixed")
    model = learn(build_individual(arm.chain, 9))
    robot = SelfModelPlant.from_urdf(arm)
    context = robot.plant.CreateDefaultContext()
    at_first = robot.plant.GetFrameByName("a").CalcPoseInWorld(context).translation()
    np.testing.assert_allclose(at_first, [0.0, 0.0, 1.0])
    robot.write(context, model)
    assert_points_agree(robot, context, model)
    built = SelfModelPlant.from_urdf(arm, model)
    assert_points_agree(built, built.plant.CreateDefaultContext(), model)


def test_a_robot_that_cannot_be_placed_is_refused(on_the_world):
    with pytest.raises(ModelError, match="joint 'mount' to the world is prismatic"):
        SelfModelPlant.from_urdf(on_the_world("prismatic"))


def test_a_robot_keeps_its_bushing(on_the_world):
    bushing = (
        '<frame name="p" link="a"/><frame name="q" link="b"/><drake:linear_bushing_rpy>'
        '<drake:bushing_frameA name="p"/><drake:bushing_frameC name="q"/>'
        + "".join(
            f'<drake:bushing_{kind}_{what} value="1 1 1"/>'
            for kind in ("torque", "force")
            for what in ("stiffness", "damping")
        )
        + "</drake:linear_bushing_rpy>"
    )
    plant = SelfModelPlant.from_urdf(on_the_world("fixed", bushing)).plant
    assert plant.num_force_elements() == 2  # and gravity


@pytest.mark.parametrize("name", ["joint2_F", "joint2_M", "base_placement"])
def test_a_frame_that_is_called_as_one_made_here_is_refused_and_leaves_the_plant(
    tmp_path, urdf_text, name
):
    frame = f'<frame name="{name}" link="link3" xyz="0 0 0" rpy="0 0 0"/></robot>'
    (tmp_path / "robot.urdf").write_text(urdf_text("six").replace("</robot>", frame))
    arm, plant = (
        ArmDescription.from_urdf(tmp_path / "robot.urdf", tip_link="ball"),
        MultibodyPlant(0.0),
    )
    with pytest.raises(ModelError, match=f"has a frame {name!r}.*: rename it"):
        SelfModelPlant.add_to(plant, arm)
    assert (plant.num_bodies(), plant.num_model_instances()) == (1, 2)


def test_what_does_not_fit_is_refused(describe, learn):
    arm, neck = describe("right_arm"), describe("neck")
    model, robot = learn(arm.chain), SelfModelPlant.from_urdf(arm)
    context = robot.plant.CreateDefaultContext()
    other = type(arm.chain)(
        arm.joints, arm.chain.directions, arm.chain.points, ("toe",), arm.chain.p_WH_zero
    )
    with pytest.raises(ModelError, match="the self-model has the joints neck_yaw"):
        robot.write(context, learn(neck.chain))
    with pytest.raises(ModelError, match="no frame for toe, only for hand"):
        robot.write(context, learn(other))
    with pytest.raises(ValueError, match="context belongs to another plant"):
        robot.write(SelfModelPlant.from_urdf(neck).plant.CreateDefaultContext(), model)
    with pytest.raises(ValueError, match="no marker 'toe'; there are hand"):
        robot.tracked_point_frame("toe")
    with pytest.raises(ValueError, match=r"q must have shape \(4,\), got \(3,\)"):
        robot.set_joint_angles(context, [0.0, 0.0, 0.0])
    with pytest.raises(ValueError, match=r"readings must have shape \(4,\), got \(2,\)"):
        robot.set_positions(context, [1.0, 2.0], model)
    with pytest.raises(ValueError, match="built without a self-model"):
        robot.set_positions(context, np.zeros(4))
    with pytest.raises(TypeError, match="ArmDescription is expected, got a NoneType: give"):
        SelfModelPlant.from_urdf(ArmDescription.of_model(learn(arm.chain)), learn(arm.chain))
    with pytest.raises(TypeError, match="SelfModel is expected, got a Chain: give a self-model"):
        SelfModelPlant.from_urdf(arm, arm.chain)


def test_the_frames_of_a_nominal_joint_hold_its_denavit_hartenberg_row(describe, learn):
    arm = describe("right_arm")
    model = learn(arm.chain)
    robot = SelfModelPlant.from_urdf(arm, model)
    context = robot.plant.CreateDefaultContext()
    frames = model.dh.frames(np.zeros(4))
    for i, joint in enumerate(arm.joints):
        F, M = (robot.plant.GetFrameByName(name) for name in frame_names(joint))
        expected = frames[i] @ model.dh.joint_motions(model.dh.theta_zero)[i]
        for frame in (F, M):
            X_WF = frame.CalcPoseInWorld(context).GetAsMatrix4()
            np.testing.assert_allclose(X_WF, expected, atol=1e-12)
