"""Nico's body: what the thesis says of it, and what Drake makes of it."""

import logging
import math
import xml.etree.ElementTree as ElementTree
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from pydrake.geometry import Role, SceneGraph
from pydrake.multibody.parsing import PackageMap, Parser
from pydrake.multibody.plant import AddMultibodyPlantSceneGraph, MultibodyPlant
from pydrake.multibody.tree import RevoluteJoint
from pydrake.systems.framework import Context, Diagram, DiagramBuilder

URDF_FOLDER = Path(__file__).resolve().parents[2] / "urdf"
URDF = URDF_FOLDER / "nico.urdf"

SIDES = ("right", "left")
ARM = ("shoulder_pitch", "shoulder_roll", "upper_arm_twist", "elbow", "forearm_twist", "wrist")
JOINTS = (
    *("torso_yaw", "torso_pitch", "torso_roll", "neck_yaw", "neck_pitch", "neck_roll"),
    *("eyes_tilt", "left_eye_pan", "right_eye_pan", "right_index", "right_fingers"),
    *(f"{side}_{joint}" for side in SIDES for joint in ARM),
)
HAND_FRAMES = ("wrist_marker", "hand_fiducial", "finger_tip")
CAMERA_FRAMES = ("wide_camera", "foveal_camera")
FRAME_LINKS = {f"{side}_{name}" for side in SIDES for name in (*HAND_FRAMES, *CAMERA_FRAMES)}
# In urdf/README.md: the right hand before the eyes, the back of the hand towards them.
LOOKING_AT_THE_HAND = {
    "neck_yaw": -40.0,
    "neck_pitch": 0.0,
    "eyes_tilt": 30.0,
    "right_shoulder_pitch": -30.0,
    "right_shoulder_roll": 50.0,
    "right_upper_arm_twist": 0.0,
    "right_elbow": -70.0,
    "right_forearm_twist": -90.0,
}
MIRROR = np.diag([1.0, -1.0, 1.0])


def parse(path: Path, builder: DiagramBuilder) -> tuple[MultibodyPlant, SceneGraph]:
    """Parse a robot that stands on its `base`, any warning being an error."""
    plant, scene_graph = AddMultibodyPlantSceneGraph(builder, MultibodyPlant(0.0))
    parser = Parser(plant)
    parser.SetStrictParsing()
    parser.AddModels(str(path))
    plant.WeldFrames(plant.world_frame(), plant.GetFrameByName("base"))
    plant.Finalize()
    return plant, scene_graph


@dataclass(frozen=True, eq=False)
class Body:
    """Nico in Drake, with one context that every test starts from zero."""

    plant: MultibodyPlant
    scene_graph: SceneGraph
    diagram: Diagram
    root: Context

    @property
    def context(self) -> Context:
        return self.plant.GetMyContextFromRoot(self.root)

    def move(self, degrees: dict[str, float]) -> None:
        for name, angle in degrees.items():
            self.plant.GetJointByName(name).set_angle(self.context, math.radians(angle))

    def rotation(self, frame: str) -> np.ndarray:
        X_WF = self.plant.GetFrameByName(frame).CalcPoseInWorld(self.context)
        return X_WF.rotation().matrix()

    def position(self, frame: str) -> np.ndarray:
        return self.plant.GetFrameByName(frame).CalcPoseInWorld(self.context).translation()

    def axis(self, joint: str) -> tuple[np.ndarray, np.ndarray]:
        """Return a joint's axis in the world: a point on it and its direction."""
        revolute = self.plant.GetJointByName(joint)
        X_WF = revolute.frame_on_parent().CalcPoseInWorld(self.context)
        return X_WF.translation(), X_WF.rotation().matrix() @ revolute.revolute_axis()

    def penetrating(self) -> list[tuple[str, str]]:
        """Return the pairs of bodies that touch (Drake leaves out neighbours)."""
        query = self.scene_graph.get_query_output_port().Eval(
            self.scene_graph.GetMyContextFromRoot(self.root)
        )
        inspector = query.inspector()

        def body_name(geometry_id: object) -> str:
            return self.plant.GetBodyFromFrameId(inspector.GetFrameId(geometry_id)).name()

        pairs = query.ComputePointPairPenetration()
        return [(body_name(pair.id_A), body_name(pair.id_B)) for pair in pairs]


@pytest.fixture(scope="module")
def shared_body() -> Body:
    builder = DiagramBuilder()
    plant, scene_graph = parse(URDF, builder)
    diagram = builder.Build()
    return Body(plant, scene_graph, diagram, diagram.CreateDefaultContext())


@pytest.fixture
def nico(shared_body: Body) -> Iterator[Body]:
    yield shared_body
    shared_body.plant.SetPositions(shared_body.context, np.zeros(shared_body.plant.num_positions()))


@pytest.fixture(scope="module")
def xml_root() -> ElementTree.Element:
    return ElementTree.parse(URDF).getroot()


def crossing(nico: Body, first_joint: str, second_joint: str) -> tuple[np.ndarray, float, float]:
    """Return where two axes are closest, the gap between them and the cosine of their angle."""
    (p_first, d_first), (p_second, d_second) = nico.axis(first_joint), nico.axis(second_joint)
    normal = np.cross(d_first, d_second)
    along_first, along_second, gap = np.linalg.solve(
        np.column_stack([d_first, -d_second, normal]), p_second - p_first
    )
    middle = (p_first + along_first * d_first + p_second + along_second * d_second) / 2
    return middle, abs(gap) * float(np.linalg.norm(normal)), float(d_first @ d_second)


def test_the_23_joints_have_their_names_and_a_motor_each(nico: Body) -> None:
    plant = nico.plant
    joints = [plant.get_joint(index) for index in plant.GetJointIndices()]
    revolute = [joint for joint in joints if isinstance(joint, RevoluteJoint)]
    motors = [plant.get_joint_actuator(index) for index in plant.GetJointActuatorIndices()]

    assert sorted(joint.name() for joint in revolute) == sorted(JOINTS)
    assert len(JOINTS) == plant.num_positions() == 23
    assert [motor.name() for motor in motors] == [motor.joint().name() for motor in motors]
    assert sorted(motor.name() for motor in motors) == sorted(JOINTS)
    assert all(0.0 < motor.effort_limit() < 20.0 for motor in motors)


def test_the_right_arm_is_the_chain_of_the_thesis(xml_root: ElementTree.Element) -> None:
    parent_joint = {
        joint.find("child").get("link"): (joint.get("name"), joint.find("parent").get("link"))
        for joint in xml_root.findall("joint")
    }
    link, chain = "right_hand_fiducial", []
    while link != "chest":
        joint, link = parent_joint[link]
        chain.append(joint)

    assert chain[:0:-1] == [f"right_{joint}" for joint in ARM]


def test_drake_reads_nico_without_a_word(caplog: pytest.LogCaptureFixture) -> None:
    with caplog.at_level(logging.INFO, logger="drake"):
        parse(URDF, DiagramBuilder())

    assert [record.getMessage() for record in caplog.records] == []


def test_a_robot_that_drake_only_half_reads_would_be_noticed(tmp_path: Path) -> None:
    half_read = tmp_path / "half_read.urdf"
    half_read.write_text(
        URDF.read_text().replace("<dynamics", '<calibration rising="0"/><dynamics')
    )

    with pytest.raises(RuntimeError, match="calibration"):
        parse(half_read, DiagramBuilder())


def test_drake_finds_nico_by_its_package_name() -> None:
    packages = PackageMap()
    packages.AddPackageXml(str(URDF_FOLDER / "package.xml"))
    plant = MultibodyPlant(0.0)
    parser = Parser(plant)
    parser.package_map().AddMap(packages)

    parser.AddModels(url="package://nico_description/nico.urdf")

    assert plant.HasBodyNamed("right_hand")


def test_nothing_has_to_be_fetched(xml_root: ElementTree.Element) -> None:
    shapes = {shape.tag for geometry in xml_root.iter("geometry") for shape in geometry}
    drake = "{http://drake.mit.edu}"

    assert shapes == {"box", "sphere", "cylinder", f"{drake}capsule", f"{drake}ellipsoid"}
    assert list(xml_root.iter("texture")) == []


def test_every_inertia_is_that_of_a_real_body(nico: Body) -> None:
    bodies = [
        nico.plant.get_body(index)
        for index in nico.plant.GetBodyIndices(nico.plant.GetModelInstanceByName("nico"))
    ]
    solid = [body for body in bodies if body.name() not in FRAME_LINKS]

    assert {body.name() for body in bodies if body.default_mass() == 0.0} == FRAME_LINKS
    for body in solid:
        inertia = body.default_spatial_inertia()
        moments = (
            inertia.Shift(inertia.get_com()).CalcRotationalInertia().CalcPrincipalMomentsOfInertia()
        )
        assert inertia.IsPhysicallyValid()
        assert np.all(moments > 0.0)
        gyration = np.sqrt(moments / body.default_mass())
        assert np.all((gyration > 0.002) & (gyration < 0.15)), body.name()
    assert 4.0 < sum(body.default_mass() for body in bodies) < 10.0


@pytest.mark.parametrize("side", SIDES)
def test_the_paired_axes_cross_at_right_angles_130_and_127_mm_apart(nico: Body, side: str) -> None:
    pairs = (
        ("shoulder_pitch", "shoulder_roll"),
        ("upper_arm_twist", "elbow"),
        ("forearm_twist", "wrist"),
    )
    crossings = [crossing(nico, *(f"{side}_{joint}" for joint in pair)) for pair in pairs]
    shoulder, elbow, wrist = (point for point, _, _ in crossings)

    assert max(gap for _, gap, _ in crossings) < 1e-12
    assert max(abs(cosine) for _, _, cosine in crossings) < 1e-12
    np.testing.assert_allclose(elbow - shoulder, [0.0, 0.0, -0.130], atol=1e-12)
    np.testing.assert_allclose(wrist - elbow, [0.0, 0.0, -0.127], atol=1e-12)


@pytest.mark.parametrize("side", SIDES)
def test_the_points_on_the_hand_lie_where_the_thesis_measured_them(nico: Body, side: str) -> None:
    shoulder, _ = nico.axis(f"{side}_shoulder_roll")
    elbow, _ = nico.axis(f"{side}_elbow")
    fiducial, finger_tip, marker = (
        nico.position(f"{side}_{name}") for name in ("hand_fiducial", "finger_tip", "wrist_marker")
    )
    outwards = np.array([0.0, -1.0 if side == "right" else 1.0, 0.0])

    assert shoulder[2] - fiducial[2] == pytest.approx(0.272, abs=1e-9)
    assert shoulder[2] - finger_tip[2] == pytest.approx(0.317, abs=1e-9)
    assert np.linalg.norm(fiducial - shoulder) == pytest.approx(math.hypot(0.272, 0.0125), abs=1e-9)
    assert np.linalg.norm(finger_tip - shoulder) == pytest.approx(
        math.hypot(0.317, 0.0165), abs=1e-9
    )
    assert np.linalg.norm(marker - elbow) == pytest.approx(0.11566, abs=1e-9)
    assert outwards @ (fiducial - shoulder) == pytest.approx(0.0125, abs=1e-9)
    np.testing.assert_allclose(nico.rotation(f"{side}_hand_fiducial")[:, 2], outwards, atol=1e-12)
    hand = nico.plant.GetBodyByName(f"{side}_hand")
    moving_with_it = {body.name() for body in nico.plant.GetBodiesWeldedTo(hand)}
    assert {f"{side}_wrist_marker", f"{side}_hand_fiducial"} <= moving_with_it


def test_the_wide_cameras_are_70_mm_apart_and_the_foveal_ones_20_mm_above(nico: Body) -> None:
    left, right = (nico.position(f"{side}_wide_camera") for side in ("left", "right"))

    np.testing.assert_allclose(left - right, [0.0, 0.070, 0.0], atol=1e-12)
    for side, wide in (("left", left), ("right", right)):
        above = nico.position(f"{side}_foveal_camera") - wide
        np.testing.assert_allclose(above, [0.0, 0.0, 0.020], atol=1e-12)


@pytest.mark.parametrize("camera", CAMERA_FRAMES)
@pytest.mark.parametrize("side", SIDES)
def test_camera_frames_look_ahead_with_y_down(nico: Body, side: str, camera: str) -> None:
    right, down, ahead = nico.rotation(f"{side}_{camera}").T

    np.testing.assert_allclose(right, [0.0, -1.0, 0.0], atol=1e-12)
    np.testing.assert_allclose(down, [0.0, 0.0, -1.0], atol=1e-12)
    np.testing.assert_allclose(ahead, [1.0, 0.0, 0.0], atol=1e-12)


def test_the_eyes_pan_one_by_one_and_tilt_together(nico: Body) -> None:
    straight = {side: nico.rotation(f"{side}_wide_camera") for side in SIDES}

    nico.move({"left_eye_pan": 20.0})
    np.testing.assert_array_equal(nico.rotation("right_wide_camera"), straight["right"])
    turned = nico.rotation("left_wide_camera")[:, 2]
    np.testing.assert_allclose(turned, [math.cos(0.349066), math.sin(0.349066), 0.0], atol=1e-6)

    nico.move({"left_eye_pan": 0.0, "eyes_tilt": 15.0})
    for side in SIDES:
        ahead = nico.rotation(f"{side}_wide_camera")[:, 2]
        assert ahead[2] == pytest.approx(-math.sin(math.radians(15.0)), abs=1e-12)


def test_every_part_can_be_seen(nico: Body) -> None:
    inspector = nico.scene_graph.model_inspector()
    instance = nico.plant.GetModelInstanceByName("nico")
    for index in nico.plant.GetBodyIndices(instance):
        body = nico.plant.get_body(index)
        frame_id = nico.plant.GetBodyFrameIdOrThrow(index)
        for role in (Role.kIllustration, Role.kPerception):
            seen = len(inspector.GetGeometries(frame_id, role))
            assert (seen > 0) == (body.name() not in FRAME_LINKS), body.name()


def test_what_is_tracked_is_drawn_where_its_frame_is(xml_root: ElementTree.Element) -> None:
    def origin(element: ElementTree.Element) -> str:
        return element.find("origin").get("xyz")

    for link, material, frame in (
        ("right_hand", "reflector", "right_wrist_marker"),
        ("left_hand", "reflector", "left_wrist_marker"),
        ("right_index_finger", "red_tape", "right_finger_tip"),
    ):
        visuals = xml_root.findall(f"link[@name='{link}']/visual")
        drawn = [visual for visual in visuals if visual.find("material").get("name") == material]
        mount = xml_root.find(f"joint[@name='{frame}_mount']")
        assert [origin(visual) for visual in drawn] == [origin(mount)]
        assert mount.find("parent").get("link") == link


def test_nothing_touches_at_zero(nico: Body) -> None:
    assert nico.penetrating() == []


def test_a_hand_pushed_into_the_hips_touches_them(nico: Body) -> None:
    nico.move({"right_shoulder_roll": -15.0})

    assert ("waist", "right_hand") in {
        tuple(sorted(pair, reverse=True)) for pair in nico.penetrating()
    }


@pytest.mark.parametrize("nod", ["lower", "upper"])
@pytest.mark.parametrize("lean", ["lower", "upper"])
def test_the_head_moves_to_its_limits_without_touching_the_body(
    nico: Body, nod: str, lean: str
) -> None:
    for name, end in (("neck_pitch", nod), ("neck_roll", lean), ("neck_yaw", lean)):
        joint = nico.plant.GetJointByName(name)
        joint.set_angle(nico.context, getattr(joint, f"position_{end}_limit")())

    assert nico.penetrating() == []


def test_zero_is_a_pose_that_every_joint_can_take(nico: Body) -> None:
    for name in JOINTS:
        joint = nico.plant.GetJointByName(name)
        lower, upper = joint.position_lower_limit(), joint.position_upper_limit()
        assert -math.pi < lower <= 0.0 < upper < math.pi, name
        assert 1.0 <= joint.velocity_upper_limit() <= 10.0, name
        assert joint.velocity_lower_limit() == -joint.velocity_upper_limit(), name


def test_the_same_angles_on_both_sides_mirror_the_arms(nico: Body) -> None:
    rng = np.random.default_rng(20)
    for _ in range(5):
        for joint in ARM:
            right, left = (nico.plant.GetJointByName(f"{side}_{joint}") for side in SIDES)
            assert left.position_lower_limit() == right.position_lower_limit()
            assert left.position_upper_limit() == right.position_upper_limit()
            angle = rng.uniform(right.position_lower_limit(), right.position_upper_limit())
            nico.move({f"{side}_{joint}": math.degrees(angle) for side in SIDES})
        for frame in ("upper_arm", "forearm", "hand", *HAND_FRAMES):
            np.testing.assert_allclose(
                nico.position(f"left_{frame}"), MIRROR @ nico.position(f"right_{frame}"), atol=1e-12
            )


def test_both_arms_weigh_the_same(nico: Body) -> None:
    for link in ("shoulder", "upper_arm", "elbow_yoke", "forearm", "lower_forearm"):
        right, left = (
            nico.plant.GetBodyByName(f"{side}_{link}").default_spatial_inertia() for side in SIDES
        )
        np.testing.assert_array_equal(left.CopyToFullMatrix6(), right.CopyToFullMatrix6())


def test_the_paired_joints_have_the_identity_as_origin(xml_root: ElementTree.Element) -> None:
    at_identity = {
        joint.get("name")
        for joint in xml_root.findall("joint")
        if joint.find("origin").attrib == {"xyz": "0 0 0"}
    }

    assert at_identity == {
        f"{side}_{name}" for side in SIDES for name in ("shoulder_roll", "elbow")
    }


def test_the_right_hand_comes_before_the_eyes(nico: Body) -> None:
    nico.move(LOOKING_AT_THE_HAND)
    p_WH = nico.position("right_hand_fiducial")
    back_of_hand = nico.rotation("right_hand_fiducial")[:, 2]

    for side in SIDES:
        R_WC, p_WC = nico.rotation(f"{side}_wide_camera"), nico.position(f"{side}_wide_camera")
        p_CH = R_WC.T @ (p_WH - p_WC)
        distance = np.linalg.norm(p_CH)
        assert 0.170 < distance < 0.380
        assert abs(p_CH[0]) < p_CH[2] * math.tan(math.radians(40.0))
        assert abs(p_CH[1]) < p_CH[2] * math.tan(math.radians(40.0)) * 480 / 640
        assert back_of_hand @ (p_WC - p_WH) > 0.75 * distance
    for name in LOOKING_AT_THE_HAND:
        joint = nico.plant.GetJointByName(name)
        angle = joint.get_angle(nico.context)
        assert joint.position_lower_limit() < angle < joint.position_upper_limit(), name
    assert nico.penetrating() == []
