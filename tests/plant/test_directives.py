"""Model directives that name a self-model: what they add, and what they refuse."""

import shutil
from pathlib import Path

import numpy as np
import pytest
from pydrake.geometry import Meshcat, MeshcatParams
from pydrake.math import RigidTransform, RollPitchYaw
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import AddMultibodyPlantSceneGraph, MultibodyPlant
from pydrake.systems.framework import DiagramBuilder
from pydrake.visualization import ModelVisualizer

from nico_selfmodel.errors import ModelError
from nico_selfmodel.model.self_model import SelfModel
from nico_selfmodel.model.self_model_file import save_model
from nico_selfmodel.model.tree.body_model import BodyModel, save_body
from nico_selfmodel.model.tree.body_tree import Attached, BodyTree
from nico_selfmodel.plant import BodyPlant, SelfModelPlant, add_directives

TABLE = """<robot name="table"><link name="top">
<visual><geometry><box size="1 1 0.1"/></geometry></visual></link></robot>"""
SCENE = """
directives:
- add_model: {name: table, file: table.urdf}
- add_weld:
    parent: world
    child: table::top
    X_PC: {translation: [0, 0, 0.7], rotation: !Rpy {deg: [0, 0, 90]}}
- add_self_model: {name: arm, model: learned.yaml, frame: table::top}
- add_model: {name: cup, file: table.urdf}
- add_weld: {parent: arm::self_model::hand_tool, child: cup::top}
"""


@pytest.fixture
def scene(tmp_path, describe, build_individual, learn):
    """Return a function that writes directives beside a self-model and a table."""
    arm = describe("six")
    chain = build_individual(arm.chain, 5)
    learned = learn(chain)
    model = SelfModel("learned", learned.table, learned.servo_map, robot=arm.source)
    save_model(model, tmp_path / "learned.yaml")
    save_model(SelfModel("nobody's", learned.table, learned.servo_map), tmp_path / "nobody.yaml")
    save_model(learn(describe("neck").chain), tmp_path / "neck.yaml")
    (tmp_path / "table.urdf").write_text(TABLE)
    shutil.copy(arm.urdf, tmp_path)

    def write(text: str) -> Path:
        path = tmp_path / "scene.yaml"
        path.write_text(text)
        return path

    write.model = model
    return write


def test_a_learned_arm_stands_on_the_table_and_carries_a_cup(scene):
    plant = MultibodyPlant(1e-3)
    robots = add_directives(scene(SCENE), Parser(plant))
    plant.Finalize()
    (arm,) = robots.values()
    assert isinstance(arm, SelfModelPlant)
    context = plant.CreateDefaultContext()
    q = np.linspace(-0.5, 0.6, 6)
    arm.set_joint_angles(context, q)
    X_WT = RigidTransform(RollPitchYaw(0.0, 0.0, np.pi / 2), [0.0, 0.0, 0.7])
    k = arm.markers.index("tool")
    expected = X_WT @ scene.model.chain.forward(q, k)
    for frame in (arm.tracked_point_frame("tool"), plant.GetFrameByName("top", _cup(plant))):
        p = frame.CalcPoseInWorld(context).translation()
        np.testing.assert_allclose(p, expected, atol=1e-9)


def _cup(plant):
    return plant.GetModelInstanceByName("cup")


def test_joints_start_where_the_directives_say(scene):
    more = "directives:\n- add_self_model:\n    name: arm\n    model: learned.yaml\n"
    text = f"{more}    default_joint_positions: {{joint2: 0.4, slide: [0.02]}}\n"
    plant = MultibodyPlant(1e-3)
    add_directives(scene(text), Parser(plant))
    plant.Finalize()
    context = plant.CreateDefaultContext()
    assert plant.GetJointByName("joint2").get_angle(context) == 0.4
    assert plant.GetJointByName("slide").get_translation(context) == 0.02


def test_another_robot_may_be_named(scene, describe):
    urdf = describe("six").urdf.name
    robot = f"{{urdf: {urdf}, tip_link: tip, held: {{slide: 0.1}}, points: {{tool: tool}}}}"
    text = f"directives:\n- add_self_model: {{name: a, model: nobody.yaml, robot: {robot}}}\n"
    plant = MultibodyPlant(1e-3)
    robots = add_directives(scene(text), Parser(plant))
    assert robots["a"].arm.held == {"slide": 0.1}


def test_a_body_is_named_as_an_arm_is_and_drawn(tmp_path, scene):
    frames = [np.eye(4), np.eye(4)]
    frames[1][:3, 3] = [0.1, 0.2, 0.4]
    tree = BodyTree(
        ("lift", "turn"), ("prismatic", "revolute"), np.array([-1, 0]), np.array(frames),
        np.ones(2), np.eye(2), (Attached("ball", 1, frames[1]),), (),
    )  # fmt: skip
    (tmp_path / "result").mkdir()
    save_body(BodyModel("crane", tree, np.ones(2)), tmp_path / "result" / "body.yaml")
    text = "directives:\n- add_self_model: {name: crane, model: result,"
    text += " default_joint_positions: {lift: 0.25}}\n"
    visualizer = ModelVisualizer(meshcat=Meshcat(MeshcatParams(host="localhost")))
    (body,) = add_directives(scene(text), visualizer.parser()).values()
    visualizer.Finalize()
    visualizer.Run(loop_once=True)
    assert isinstance(body, BodyPlant)
    assert visualizer.meshcat().HasPath("/drake/illustration/crane/turn")
    context = body.plant.CreateDefaultContext()
    p = body.frame("ball").CalcPoseInWorld(context).translation()
    np.testing.assert_allclose(p, [0.2, 0.4, 1.05])


LINE = "directives:\n- add_self_model: "


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("directives: 3\n", "'directives' must be a list"),
        ("models: []\n", "expected the key 'directives' and nothing else at the top"),
        ("directives: [\n", "line 2: not valid YAML"),
        (LINE + "{name: a, modell: learned.yaml}", "unknown key 'modell', did you mean 'model'?"),
        (LINE + "{name: a}", "key 'model' is missing"),
        (LINE + "[a]", "expected a mapping with name, model"),
        (LINE + "{name: a, model: gone.yaml}", "gone.yaml does not exist"),
        (LINE + "{name: a, model: learned.yaml, frame: t::top}", "no model instance named 't'"),
        (LINE + "{name: a, model: nobody.yaml}", "names no robot: give robot with its urdf"),
        (LINE + "{name: a, model: neck.yaml, robot: {urdf: nico}}", "choose tip_link"),
        (
            LINE + "{name: a, model: neck.yaml, robot: {urdf: six.urdf, tip_link: tip, "
            "held: {slide: 0}}}",
            "directive 1, add_self_model: the self-model has the joints neck_yaw",
        ),
        (
            LINE + "{name: a, model: learned.yaml, default_joint_positions: {knee: 1}}",
            "no joint 'knee'",
        ),
        (
            LINE + "{name: a, model: nobody.yaml, robot: {urdf: nico, held: 3}}",
            "held must be a",
        ),
        (LINE + "{name: a, model: nobody.yaml, robot: {urdf: nico, tip_link: 3}}", "must be text"),
        ("directives:\n- add_modell: {name: t}\n", "directive 1: .*'add_modell' did not match"),
        ("directives:\n- add_weld: {parent: world, child: q::r}\n", "no model instance named 'q'"),
        ("directives:\n- add_model: {name: t, file: gone.urdf}\n", "gone.urdf.* does not exist"),
    ],
)
def test_directives_that_name_what_is_not_there_are_refused_in_one_line(scene, text, message):
    plant = MultibodyPlant(1e-3)
    with pytest.raises(ModelError, match=message) as caught:
        add_directives(scene(text), Parser(plant))
    assert "\n" not in str(caught.value)


def test_a_finalized_plant_takes_no_directives(scene):
    plant = MultibodyPlant(1e-3)
    parser = Parser(plant)
    plant.Finalize()
    with pytest.raises(ModelError, match="finalized already"):
        add_directives(scene(SCENE), parser)


def test_the_model_visualizer_shows_a_learned_arm(scene):
    meshcat = Meshcat(MeshcatParams(host="localhost"))
    visualizer = ModelVisualizer(meshcat=meshcat)
    (arm,) = add_directives(scene(SCENE), visualizer.parser()).values()
    visualizer.Finalize()
    visualizer.Run(loop_once=True)
    assert meshcat.HasPath("/drake/illustration/arm/link6")
    assert meshcat.HasPath("/drake/illustration/table")
    assert f"{arm.arm.joints[0]}" in " ".join(meshcat.GetSliderNames())


BALLS = """<robot name="balls"><link name="one"><collision><geometry><sphere radius="0.1"/>
</geometry></collision></link><link name="two"><collision><geometry><sphere radius="0.1"/>
</geometry></collision></link></robot>"""
"""Two balls that lie in each other."""


def overlaps(scene, text):
    """Return which bodies of a scene collide where all start at the origin."""
    path = scene(text)
    (path.parent / "balls.urdf").write_text(BALLS)
    builder = DiagramBuilder()
    plant, graph = AddMultibodyPlantSceneGraph(builder, 1e-3)
    add_directives(path, Parser(plant))
    plant.Finalize()
    context = builder.Build().CreateDefaultContext()
    query = graph.get_query_output_port().Eval(graph.GetMyContextFromRoot(context))
    inspector = query.inspector()
    return {
        frozenset(inspector.GetName(inspector.GetFrameId(k)) for k in (pair.id_A, pair.id_B))
        for pair in query.ComputePointPairPenetration()
    }


TWO = """directives:
- add_model: {name: a, file: balls.urdf}
- add_model: {name: b, file: balls.urdf}
"""
GROUP = (
    "- add_collision_filter_group: {name: %s, members: [%s], ignored_collision_filter_groups: [%s]}"
)


def test_collision_filter_groups_reach_across_models_that_stand_before_and_after_them(scene):
    a, b = (["a::one", "a::two"], ["b::one", "b::two"])
    everything = {frozenset(pair) for pair in (a, b, *((one, two) for one in a for two in b))}
    assert overlaps(scene, TWO) == everything
    two = TWO + GROUP % ("ours", ", ".join(a), "theirs") + "\n"
    two += GROUP % ("theirs", ", ".join(b), "") + "\n"
    assert overlaps(scene, two) == {frozenset(a), frozenset(b)}
    one = TWO.replace("directives:\n", "directives:\n" + GROUP % ("g", ", ".join(a), "g") + "\n")
    assert overlaps(scene, one) == everything - {frozenset(a)}
    in_it = (GROUP % ("g", "b::one", "g")).replace("members:", "member_groups: [h], members:")
    both = TWO + in_it + "\n" + GROUP % ("h", "a::two", "") + "\n"
    assert overlaps(scene, both) == everything - {frozenset(["a::two", "b::one"])}


@pytest.mark.parametrize(
    ("members", "ignored", "why"),
    [
        ("a::three", "g", "three"),
        ("a::one", "h", "no group 'h'; there are g"),
    ],
)
def test_a_collision_filter_group_of_nothing_is_refused_by_its_place(scene, members, ignored, why):
    with pytest.raises(ModelError, match=f"directive 3: .*{why}"):
        overlaps(scene, TWO + GROUP % ("g", members, ignored))
    with pytest.raises(ModelError, match="there is a group 'g' already"):
        overlaps(scene, TWO + "\n".join([GROUP % ("g", "a::one", "g")] * 2))


def test_a_self_model_in_a_file_that_another_one_names_is_refused_by_name(scene):
    inner = scene("directives:\n- add_self_model: {name: arm, model: learned.yaml}\n")
    inner = inner.rename(inner.with_name("inner.yaml"))
    outer = scene(f"directives:\n- add_directives: {{file: {inner.as_uri()}}}\n")
    said = "directive 1: add_self_model in a file that another one names: put it into .*scene.yaml"
    plant = MultibodyPlant(0.0)
    with pytest.raises(ModelError, match=said):
        add_directives(outer, Parser(plant))
