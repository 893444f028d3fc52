import re
import xml.etree.ElementTree as ElementTree
from dataclasses import replace

import numpy as np
import pytest
from pydrake.geometry import Role
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import AddMultibodyPlantSceneGraph, MultibodyPlant
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder

from nico_selfmodel.errors import ModelError
from nico_selfmodel.plant import ArmDescription, SelfModelPlant, learned_urdf
from nico_selfmodel.plant.export.urdf_export import MEASURING_FRAME
from nico_selfmodel.plant.learned_frames import learned_frames


def loaded(path):
    """Load a URDF as a user would, with its geometry, the measuring frame at the world's."""
    builder = DiagramBuilder()
    plant, scene_graph = AddMultibodyPlantSceneGraph(builder, MultibodyPlant(0.0))
    parser = Parser(plant)
    parser.SetStrictParsing()
    parser.AddModels(str(path))
    plant.Finalize()
    return plant, scene_graph, builder.Build().CreateDefaultContext()


def set_joints(plant, context, values):
    for name, value in values.items():
        positions = plant.GetPositions(context).copy()
        positions[plant.GetJointByName(name).position_start()] = value
        plant.SetPositions(context, positions)


@pytest.fixture
def learned(arm, build_individual, learn):
    return learn(build_individual(arm.chain, seed=11))


@pytest.fixture
def exported(arm, learned, tmp_path):
    path = tmp_path / "learned.urdf"
    path.write_text(learned_urdf(learned, arm))
    return path


def test_an_export_moves_in_drake_as_the_chain_does(arm, learned, exported, drake_warnings):
    plant, _, root = loaded(exported)
    context = plant.GetMyContextFromRoot(root)
    W = plant.GetFrameByName(MEASURING_FRAME)
    set_joints(plant, context, arm.held)
    for q in np.random.default_rng(1).uniform(-3.0, 3.0, (4, len(arm.joints))):
        set_joints(plant, context, dict(zip(arm.joints, q, strict=True)))
        for k, marker in enumerate(arm.markers):
            expected = learned.chain.forward(q, k)
            # The marker's own link, which had to move, and the frame that is always there.
            for name in (arm.points[marker], f"hand_{marker}"):
                X_WH = plant.CalcRelativeTransform(context, W, plant.GetFrameByName(name))
                np.testing.assert_allclose(X_WH.translation(), expected, rtol=0, atol=1e-12)
    assert drake_warnings == []


def test_an_export_described_again_has_the_learned_chain(arm, learned, exported):
    plain = MultibodyPlant(0.0)
    Parser(plain).AddModels(str(exported))
    below = {
        plain.get_joint(i).name(): 0.0
        for i in plain.GetJointIndices()
        if plain.get_joint(i).num_positions() == 1 and plain.get_joint(i).name() not in arm.joints
    }
    again = ArmDescription.from_urdf(
        exported, MEASURING_FRAME, arm.tip_link, {**below, **arm.held}, arm.points
    )
    assert again.joints == arm.joints
    zeros = learned_frames(arm, learned.chain).zeros
    np.testing.assert_allclose(again.lower, arm.lower - zeros, rtol=0, atol=1e-15)
    np.testing.assert_allclose(again.upper, arm.upper - zeros, rtol=0, atol=1e-15)
    for name in ("directions", "p_WH_zero"):
        ours, learnt = getattr(again.chain, name), getattr(learned.chain, name)
        np.testing.assert_allclose(ours, learnt, rtol=0, atol=1e-12)
    apart = again.chain.points - learned.chain.points
    off_axis = apart - np.sum(apart * again.chain.directions, axis=1)[:, None] * (
        again.chain.directions
    )
    np.testing.assert_allclose(off_axis, 0.0, atol=1e-12)


BODY = """<inertial><mass value="0.5"/><inertia ixx="1e-2" iyy="1e-2" izz="1e-2" ixy="0" ixz="0"
iyz="0"/></inertial>"""
LINKS = "".join(f'<link name="{name}">{BODY}</link>' for name in "abcd")
MIMICKED = f"""<robot name="m">{LINKS}
<joint name="one" type="revolute"><parent link="a"/><child link="b"/><axis xyz="0 1 0"/>
  <limit lower="-1" upper="2" effort="1" velocity="1"/></joint>
<joint name="two" type="revolute"><parent link="b"/><child link="c"/><origin xyz="0.3 0 0.1"/>
  <axis xyz="1 0 0"/><limit lower="-3" upper="3" effort="1" velocity="1"/></joint>
<joint name="three" type="revolute"><parent link="c"/><child link="d"/><origin xyz="0.1 0.2 0.1"/>
  <axis xyz="0 0 1"/><limit lower="-9" upper="9" effort="1" velocity="1"/>
  <mimic joint="two" multiplier="-2" offset="0.25"/></joint>
<link name="tool"/><joint name="four" type="fixed"><parent link="c"/><child link="tool"/>
  <origin xyz="0.1 0.2 0.3"/></joint></robot>"""


def moved_in(plant, follows, seconds=0.02):
    """Return how far the joints move by themselves where one follows another as is said [rad]."""
    plant.mutable_gravity_field().set_gravity_vector(np.zeros(3))
    plant.Finalize()
    simulator = Simulator(plant)
    context = simulator.get_mutable_context()
    plant.GetJointByName("two").set_angle(context, 0.3)
    plant.GetJointByName("three").set_angle(context, follows(0.3))
    before = plant.GetPositions(context).copy()
    simulator.AdvanceTo(seconds)
    return np.abs(plant.GetPositions(context) - before)[-3:].max()


@pytest.mark.parametrize(("apart", "counted"), [(0.1, False), (0.2, True), (-1.5, True)])
def test_limits_and_what_mimics_are_counted_from_zeros_of_a_models_own(
    tmp_path, learn, apart, counted
):
    (tmp_path / "r.urdf").write_text(MIMICKED)
    arm = ArmDescription.from_urdf(tmp_path / "r.urdf", "a", "tool")
    model = learn(arm.chain.rezeroed(np.array([0.5, apart])))
    # How the first link is turned about its axis and how the base is are one.
    zeros = np.array([0.0, apart]) * counted
    np.testing.assert_allclose(learned_frames(arm, model.chain).zeros, zeros, atol=1e-12)
    (tmp_path / "learned.urdf").write_text(learned_urdf(model, arm))
    ours, exported, other = MultibodyPlant(1e-3), MultibodyPlant(1e-3), MultibodyPlant(1e-3)
    SelfModelPlant.add_to(ours, arm, model)
    for plant in (exported, other):
        Parser(plant).AddModels(str(tmp_path / "learned.urdf"))
        plant.WeldFrames(plant.world_frame(), plant.GetFrameByName("a"))
    for plant in (ours, exported):
        # q3 = -2 (q2 + zero2) + 0.25
        assert moved_in(plant, lambda q2: 0.25 - 2.0 * (q2 + zeros[1])) < 1e-6
        for name, zero, low, high in (("one", zeros[0], -1, 2), ("two", zeros[1], -3, 3)):
            joint = plant.GetJointByName(name)
            assert joint.position_lower_limit() == pytest.approx(low - zero, abs=1e-12)
            assert joint.position_upper_limit() == pytest.approx(high - zero, abs=1e-12)
    assert moved_in(other, lambda q2: 0.35 - 2.0 * (q2 + zeros[1])) > 1e-3


def test_shapes_and_masses_of_an_export_lie_where_those_of_the_plant_do(arm, learned, exported):
    builder = DiagramBuilder()
    robot = SelfModelPlant.from_urdf(arm, learned, builder=builder)
    ours, theirs = builder.Build().CreateDefaultContext(), loaded(exported)
    q = np.linspace(-0.7, 0.9, len(arm.joints))
    joints = {**arm.held, **dict(zip(arm.joints, q, strict=True))}
    seen = []
    for plant, scene_graph, root in ((robot.plant, robot.scene_graph, ours), theirs):
        context = plant.GetMyContextFromRoot(root)
        set_joints(plant, context, joints)
        W = (
            plant.GetFrameByName(MEASURING_FRAME)
            if plant.HasFrameNamed(MEASURING_FRAME)
            else plant.world_frame()
        )
        X_W = plant.CalcRelativeTransform(context, W, plant.world_frame())
        query = scene_graph.get_query_output_port().Eval(scene_graph.GetMyContextFromRoot(root))
        inspector = query.inspector()
        shapes = {}
        for role in (Role.kIllustration, Role.kProximity):
            for geometry in inspector.GetAllGeometryIds(role):
                body = plant.GetBodyFromFrameId(inspector.GetFrameId(geometry)).name()
                X = (X_W @ query.GetPoseInWorld(geometry)).GetAsMatrix4()
                shapes.setdefault((role, body), []).append(X)
        seen.append((shapes, X_W @ plant.CalcCenterOfMassPositionInWorld(context)))
    assert set(seen[0][0]) == set(seen[1][0])
    assert {body for _, body in seen[0][0]} >= set(arm.links.child_links)
    for key, poses in seen[0][0].items():
        np.testing.assert_allclose(seen[1][0][key], poses, atol=1e-12, err_msg=str(key))
    np.testing.assert_allclose(seen[1][1], seen[0][1], atol=1e-12)


@pytest.mark.parametrize("tag", ["joint", "drake:joint"])
def test_what_hangs_on_a_learned_link_by_a_joint_of_drakes_moves_with_it(
    tmp_path, urdf_text, learn, build_individual, tag
):
    kind = "ball" if tag == "drake:joint" else "fixed"
    cup = f"""<link name="cup"><inertial><mass value="0.1"/><inertia ixx="1e-3" iyy="1e-3"
    izz="1e-3" ixy="0" ixz="0" iyz="0"/></inertial></link><{tag} name="swivel" type="{kind}">
    <parent link="link4"/><child link="cup"/><origin xyz="0 0 0.1"/></{tag}></robot>"""
    (tmp_path / "robot.urdf").write_text(urdf_text("six").replace("</robot>", cup))
    arm = ArmDescription.from_urdf(tmp_path / "robot.urdf", tip_link="ball")
    model = learn(build_individual(arm.chain, seed=8))
    (tmp_path / "learned.urdf").write_text(learned_urdf(model, arm))
    plant, _, root = loaded(tmp_path / "learned.urdf")
    robot, q = SelfModelPlant.from_urdf(arm, model), np.linspace(-0.4, 0.7, len(arm.joints))
    context = robot.plant.CreateDefaultContext()
    robot.set_joint_angles(context, q)
    expected = robot.plant.GetFrameByName("cup").CalcPoseInWorld(context).translation()
    own = plant.GetMyContextFromRoot(root)
    set_joints(plant, own, dict(zip(arm.joints, q, strict=True)))
    X_WC = plant.CalcRelativeTransform(
        own, plant.GetFrameByName(MEASURING_FRAME), plant.GetFrameByName("cup")
    )
    np.testing.assert_allclose(X_WC.translation(), expected, rtol=0, atol=1e-12)


def test_a_robot_as_described_is_exported_as_it_was(arm, learn):
    original = arm.urdf.read_text()
    text = learned_urdf(learn(arm.chain), arm)
    assert re.findall(r"<origin [^>]*>", text)[: original.count("<origin ")] == re.findall(
        r"<origin [^>]*>", original
    )
    assert text.count("<origin ") <= original.count("<origin ") + 1 + len(arm.markers)


def test_an_export_keeps_the_files_comments_prefixes_and_axes(describe, learn, build_individual):
    arm = describe("right_arm")
    original = arm.urdf.read_text()
    text = learned_urdf(learn(build_individual(arm.chain, 2)), arm)
    assert 'xmlns:drake="http://drake.mit.edu"' in text
    for pattern in (r"<drake:\w+", r"<axis [^>]*>", r"<limit [^>]*>", r"<mass [^>]*>"):
        assert re.findall(pattern, text) == re.findall(pattern, original)
    assert re.findall(r"<!--.*?-->", original, re.DOTALL) == [
        comment
        for comment in re.findall(r"<!--.*?-->", text, re.DOTALL)
        if "self_model.yaml" not in comment
    ]


def test_an_export_says_what_it_cannot_hold(describe, learn):
    arm = describe("neck")
    model = replace(learn(arm.chain), name="odd--name-")
    for description in (arm, None):
        text = learned_urdf(model, description)
        (note,) = re.findall(r"<!--[^>]*self_model\.yaml[^>]*-->", text)
        assert "offsets and gears of the encoders" in " ".join(note.split())
        ElementTree.fromstring(text.replace("drake:", "drake_"))


def test_an_export_can_be_learned_and_exported_again(
    arm, learned, exported, build_individual, learn
):
    choice = (arm.base_link, arm.tip_link, arm.held, arm.points)
    first = ArmDescription.from_urdf(exported, *choice)
    model = learn(build_individual(first.chain, seed=12))
    path = exported.with_name("again.urdf")
    path.write_text(learned_urdf(model, first))
    plant, _, root = loaded(path)
    context = plant.GetMyContextFromRoot(root)
    set_joints(plant, context, arm.held)
    q = np.linspace(-1.0, 1.0, len(arm.joints))
    set_joints(plant, context, dict(zip(arm.joints, q, strict=True)))
    frames = [plant.GetFrameByName(MEASURING_FRAME), plant.GetFrameByName(f"hand_{arm.markers[0]}")]
    p = plant.CalcRelativeTransform(context, *frames).translation()
    np.testing.assert_allclose(p, model.chain.forward(q), rtol=0, atol=1e-12)


def test_without_a_description_the_arm_is_drawn_along_its_axes(
    arm, learned, tmp_path, drake_warnings
):
    path = tmp_path / "plain.urdf"
    path.write_text(learned_urdf(learned))
    plant, scene_graph, _ = loaded(path)
    assert plant.num_positions() == len(arm.joints) + 7
    assert scene_graph.model_inspector().num_geometries() >= 2 * len(arm.joints) - 1
    last = f"{arm.joints[-1]}_link"
    again = ArmDescription.from_urdf(
        path, MEASURING_FRAME, last, points={m: f"hand_{m}" for m in arm.markers}
    )
    for q in np.random.default_rng(1).uniform(-3.0, 3.0, (4, len(arm.joints))):
        for k in range(len(arm.markers)):
            np.testing.assert_allclose(
                again.chain.forward(q, k), learned.chain.forward(q, k), rtol=0, atol=1e-12
            )
    assert drake_warnings == []


def test_a_tracked_link_with_a_body_stays_and_its_frame_moves(
    describe, learn, build_individual, tmp_path
):
    arm = describe("six", points={"ball": "ball", "tip": "tip"})
    model = learn(build_individual(arm.chain, 13))
    text = learned_urdf(model, arm)
    again = tmp_path / "again.urdf"
    again.write_text(text)
    at_hand, at_tip = (
        ArmDescription.from_urdf(
            again, MEASURING_FRAME, "tip", arm.held, {"ball": "ball", "tip": name}
        )
        for name in ("hand_tip", "tip")
    )
    q = np.linspace(-1.0, 1.0, 6)
    np.testing.assert_allclose(at_hand.chain.forward(q, 1), model.chain.forward(q, 1), atol=1e-12)
    assert np.linalg.norm(at_tip.chain.forward(q, 1) - model.chain.forward(q, 1)) > 1e-3


def test_a_point_the_robot_does_not_know_gets_a_frame(describe, learn):
    arm = describe("right_arm")
    model = learn(replace(arm.chain, markers=("thumb",)))
    assert '<link name="hand_thumb"/>' in learned_urdf(model, arm)


@pytest.mark.parametrize(
    ("mesh", "lead"),
    [
        ("meshes/link2.obj", "../meshes/link2.obj"),
        ("package://nowhere/link2.obj", "package://nowhere/link2.obj"),
        ("/somewhere/link2.obj", "/somewhere/link2.obj"),
    ],
)
def test_mesh_paths_lead_to_the_same_files(tmp_path, urdf_text, learn, mesh, lead):
    path = tmp_path / "six.urdf"
    path.write_text(urdf_text("six", mesh=mesh))
    arm = ArmDescription.from_urdf(path, tip_link="ball")
    model = learn(arm.chain)
    assert f'filename="{mesh}"' in learned_urdf(model, arm)
    assert f'filename="{lead}"' in learned_urdf(model, arm, folder=tmp_path / "result")


def test_a_link_of_the_robots_own_is_not_taken_for_a_frame(tmp_path, urdf_text, learn):
    path = tmp_path / "six.urdf"
    path.write_text(urdf_text("six").replace('"finger"', f'"{MEASURING_FRAME}"'))
    arm = ArmDescription.from_urdf(path, tip_link="ball")
    with pytest.raises(ModelError, match="has a link 'measuring_frame' of its own"):
        learned_urdf(learn(arm.chain), arm)


def test_a_self_model_of_other_joints_is_not_exported(describe, learn):
    with pytest.raises(ModelError, match="the self-model has the joints neck_yaw"):
        learned_urdf(learn(describe("neck").chain), describe("right_arm"))
