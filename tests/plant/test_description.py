import numpy as np
import pytest
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import MultibodyPlant

from nico_selfmodel.errors import ModelError
from nico_selfmodel.model.self_model import SelfModel
from nico_selfmodel.model.self_model_file import load_model, save_model
from nico_selfmodel.plant import ArmDescription


def drake_points(arm: ArmDescription, q):
    """Return the tracked points in the base link by a plain Drake plant. Shape (m, 3)."""
    plant = MultibodyPlant(0.0)
    Parser(plant).AddModels(str(arm.urdf))
    plant.Finalize()
    context = plant.CreateDefaultContext()
    positions = plant.GetPositions(context).copy()
    for name, value in {**arm.held, **dict(zip(arm.joints, q, strict=True))}.items():
        positions[plant.GetJointByName(name).position_start()] = value
    plant.SetPositions(context, positions)
    base = plant.GetFrameByName(arm.base_link)
    frames = [plant.GetFrameByName(name) for name in arm.points.values()]
    return [plant.CalcRelativeTransform(context, base, f).translation() for f in frames]


def test_the_nominal_chain_moves_as_the_urdf_does(arm):
    for q in np.random.default_rng(1).uniform(-3.0, 3.0, (5, len(arm.joints))):
        predicted = [arm.chain.forward(q, k) for k in range(len(arm.markers))]
        np.testing.assert_allclose(predicted, drake_points(arm, q), atol=1e-12)


def test_nicos_right_arm_has_the_four_joints_of_the_thesis():
    arm = ArmDescription.named()
    joints = ("shoulder_pitch", "shoulder_roll", "upper_arm_twist", "elbow")
    assert arm.joints == tuple(f"right_{joint}" for joint in joints)
    assert arm.markers == ("hand",)
    assert dict(arm.held) == {"right_forearm_twist": 0.0, "right_wrist": 0.0}
    assert (arm.lower < arm.upper).all()
    assert np.isfinite([arm.lower, arm.upper]).all()
    # 257 mm from shoulder to wrist, and the marker not far from it.
    shoulder = arm.chain.points[0]
    assert 0.22 < np.linalg.norm(arm.chain.p_WH_zero[0] - shoulder) < 0.28


def test_limits_are_read_and_continuous_joints_have_none(describe):
    arm = describe("six")
    np.testing.assert_allclose(arm.lower, [-1.0, -1.1, -1.2, -1.3, -np.inf, -1.5])
    np.testing.assert_allclose(arm.upper, [2.0, 2.1, 2.2, 2.3, np.inf, 2.5])


def test_base_and_tip_default_to_the_root_and_the_only_leaf(tmp_path):
    path = tmp_path / "two.urdf"
    path.write_text(
        '<robot name="two"><link name="root"/><link name="leaf"/><joint name="j" type="continuous">'
        '<parent link="root"/><child link="leaf"/></joint></robot>'
    )
    arm = ArmDescription.from_urdf(path)
    assert (arm.base_link, arm.tip_link, arm.joints) == ("root", "leaf", ("j",))
    assert dict(arm.points) == {"hand": "leaf"}


def test_the_base_may_be_any_link_that_stands_still_against_the_first_joint(describe):
    usual = describe("six", base_link="bracket")
    aside = describe("six", base_link="link2")
    assert usual.joints == aside.joints == ("joint3", "joint4", "joint5", "joint6")
    beside = ArmDescription.from_urdf(
        "nico", "left_shoulder", "right_hand",
        {"right_forearm_twist": 0.0, "right_wrist": 0.0, "left_shoulder_pitch": 0.3},
        {"hand": "right_wrist_marker"},
    )  # fmt: skip
    assert beside.joints == ArmDescription.named().joints
    q = np.array([0.1, 0.2, 0.3, 0.4])
    np.testing.assert_allclose([beside.chain.forward(q)], drake_points(beside, q), atol=1e-12)


def test_meshes_that_are_not_there_do_no_harm(tmp_path, urdf_text, drake_warnings):
    path = tmp_path / "six.urdf"
    path.write_text(urdf_text("six", mesh="package://nowhere/link2.obj"))
    arm = ArmDescription.from_urdf(path, tip_link="tip", held={"slide": 0.0})
    assert len(arm.joints) == 6
    assert drake_warnings == []


def test_a_saved_self_model_finds_its_robot_again(arm, learn, tmp_path):
    model = learn(arm.chain)
    assert ArmDescription.of_model(model) is None
    saved = SelfModel(model.name, model.dh, model.servos, robot=arm.source)
    save_model(saved, tmp_path / "self_model.yaml")
    again = ArmDescription.of_model(load_model(tmp_path / "self_model.yaml"))
    assert again is not None
    assert again.source == arm.source
    np.testing.assert_array_equal(again.chain.p_WH_zero, arm.chain.p_WH_zero)


TWO_ROOTS = """<robot name="r"><link name="a"/><link name="b"/><link name="c"/>
<joint name="one" type="continuous"><parent link="a"/><child link="b"/></joint></robot>"""
MIMIC = """<robot name="m"><link name="a"/><link name="b"/><link name="c"/>
<joint name="one" type="continuous"><parent link="a"/><child link="b"/></joint>
<joint name="two" type="continuous"><parent link="b"/><child link="c"/><mimic joint="one"/></joint>
</robot>"""


@pytest.mark.parametrize(
    ("text", "choice", "message"),
    [
        (None, {}, "neither a robot's name"),
        ("hello <", {}, "not valid XML: syntax error"),
        ("<robot name='r'/>", {}, "without links"),
        ("six", {}, "has 2 leaf links, choose tip_link .--tip. among ball, finger"),
        ("six", {"tip_link": "hand"}, "has no link 'hand'; it has ball, base, bracket, finger"),
        ("six", {"tip_link": "tip"}, "'slide' between 'base' and 'tip' is prismatic: only revolut"),
        ("six", {"tip_link": "tip", "held": {"slid": 0}}, "no joint 'slid'; it has slide, weld2"),
        ("six", {"tip_link": "ball", "held": {"weld2": 0}}, "'weld2' is weld: there is nothing to"),
        ("six", {"tip_link": "ball", "held": {"slide": np.nan}}, "'slide' cannot be held at nan"),
        ("six", {"tip_link": "ball", "held": {"slide": 3}}, "'slide' cannot be held at 3 m: it mo"),
        ("six", {"tip_link": "base"}, "no revolute joint that is not held lies between"),
        ("six", {"base_link": "ball", "tip_link": "base"}, "passes joint 'joint6' backwards"),
        ("six", {"tip_link": "ball", "points": {"a": "nose"}}, "no link or frame 'nose'"),
        ("six", {"tip_link": "ball", "points": {"a": "link1"}}, "not on the hand: joint 'joint6'"),
        ("six", {"tip_link": "ball", "points": {"a": "tool"}}, "'tool' moves with joint 'slide'"),
        ("<robot name='r'><link name='a&b;'/></robot>", {"tip_link": "x"}, "undefined entity"),
        ("<model/>", {}, "not a URDF: its root element must be <robot>"),
        (TWO_ROOTS, {"tip_link": "b"}, "has 2 root links, choose base_link .--base. among a, c"),
        (TWO_ROOTS, {"base_link": "c", "tip_link": "b"}, "no path from 'c' to 'b': the one hangs"),
        (MIMIC, {}, "joint two mimics another joint"),
    ],
)
def test_what_cannot_be_learned_is_named_with_what_can(tmp_path, urdf_text, text, choice, message):
    path = tmp_path / "robot.urdf"
    if text is not None:
        path.write_text(urdf_text(text) if text == "six" else text)
    with pytest.raises(ModelError, match=message):
        ArmDescription.from_urdf(path, **choice)


def test_another_format_is_refused(tmp_path):
    (tmp_path / "arm.sdf").write_text("<sdf/>")
    with pytest.raises(ModelError, match=r"arm\.sdf is not a URDF: its name must end with \.urdf"):
        ArmDescription.from_urdf(tmp_path / "arm.sdf")


def test_a_self_model_of_other_joints_is_refused(describe):
    with pytest.raises(
        ModelError, match="the self-model has the joints a, b, and the chain from chest"
    ):
        describe("neck").check_joints(("a", "b"))
