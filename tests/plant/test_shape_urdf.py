"""The learned shape of links in an exported URDF."""

import re

import numpy as np
import pytest
from pydrake.geometry import Capsule, Mesh, Role
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import AddMultibodyPlantSceneGraph, MultibodyPlant
from pydrake.systems.framework import DiagramBuilder

from nico_selfmodel.errors import ModelError
from nico_selfmodel.geometry.solids.solid import Solid, distance_to_solids
from nico_selfmodel.geometry.transform import apply
from nico_selfmodel.model.shape.link_shape import BodyShape
from nico_selfmodel.plant import learned_urdf
from nico_selfmodel.plant.export.shape_urdf import ShapeInUrdf, painted_obj, share_within

from ..learned_ball import ball_body, ball_shape


def drawn_and_colliding(path, link):
    """Return what Drake draws and collides of a link, as (shape, pose in it)."""
    builder = DiagramBuilder()
    plant, scene_graph = AddMultibodyPlantSceneGraph(builder, MultibodyPlant(0.0))
    parser = Parser(plant)
    parser.SetStrictParsing()
    parser.AddModels(str(path))
    plant.Finalize()
    frame = plant.GetBodyFrameIdOrThrow(plant.GetBodyByName(link).index())
    inspector = scene_graph.model_inspector()
    return [
        [
            (inspector.GetShape(one), inspector.GetPoseInFrame(one).GetAsMatrix4())
            for one in inspector.GetGeometries(frame, role)
        ]
        for role in (Role.kIllustration, Role.kProximity)
    ]


def written(shape, model, arm, folder):
    path = folder / "learned.urdf"
    put = ShapeInUrdf.beside(path, shape)
    (folder / put.folder).mkdir()
    for name, text in put.files.items():
        (folder / put.folder / name).write_text(text)
    path.write_text(learned_urdf(model, arm, folder, put))
    return path, put


@pytest.fixture
def learned(arm, build_individual, learn):
    return learn(build_individual(arm.chain, seed=11))


def test_drake_draws_the_mesh_and_collides_with_capsules_that_hold_it(
    arm, learned, tmp_path, drake_warnings
):
    links = arm.links.child_links[:2]
    shape = ball_body(*links)
    path, put = written(shape, learned, arm, tmp_path)
    for link, own in shape.links.items():
        ((mesh, X_NF),), colliding = drawn_and_colliding(path, link)
        assert isinstance(mesh, Mesh)
        hull = mesh.GetConvexHull()
        corners = np.array([hull.vertex(k) for k in range(hull.num_vertices())])
        size = np.ptp(own.mesh.vertices, axis=0)
        np.testing.assert_allclose(np.ptp(corners, axis=0), size, atol=1e-6)
        # The frame moved as the joint was learned, mesh and capsules with it.
        assert not np.allclose(X_NF, np.eye(4), atol=1e-6)
        assert colliding
        assert all(isinstance(one, Capsule) for one, _ in colliding)
        solids = [Solid("capsule", (one.radius(), one.length()), X) for one, X in colliding]
        outside = distance_to_solids(solids, apply(X_NF, own.mesh.vertices[own.seen]))[0]
        assert np.mean(outside <= own.sigma[own.seen]) >= 0.98
        assert share_within(put.capsules[link], own) >= 0.98
    assert re.fullmatch(rf"{links[0]}: \d capsules? about 100.0 % .*; {links[1]}: .*", put.words)
    assert drake_warnings == []


def test_other_links_look_as_they_are_described(arm, learned, tmp_path):
    described = tmp_path / "described.urdf"
    described.write_text(learned_urdf(learned, arm, tmp_path))
    *others, last = arm.links.child_links
    path, _ = written(ball_body(last), learned, arm, tmp_path)
    for link in others:
        ours, theirs = (drawn_and_colliding(one, link) for one in (path, described))
        assert [len(role) for role in ours] == [len(role) for role in theirs]


def test_a_shape_of_links_that_the_robot_lacks_and_one_never_seen_are_refused(arm, learned):
    put = ShapeInUrdf.beside(arm.urdf, ball_body("tail"))
    with pytest.raises(ModelError, match="the learned shape is of tail, the robot has the links"):
        learned_urdf(learned, arm, shape=put)
    own = ball_shape("head")
    unseen = type(own)("head", own.mesh, own.sigma, own.colors, own.looks, np.zeros_like(own.seen))
    with pytest.raises(ModelError, match="nothing of link 'head' was seen"):
        ShapeInUrdf.beside(arm.urdf, BodyShape({"head": unseen}, {"head": np.eye(4)}))


def test_a_mesh_is_painted_in_the_colours_seen_and_grey_where_it_never_was():
    obj, mtl = painted_obj(ball_shape("head"), "head.mtl")
    paints = re.findall(r"^newmtl (\S+)\nKd (.*)$", mtl, re.MULTILINE)
    assert len(paints) < 12
    assert ("never_seen", "0.62 0.64 0.67") in paints
    assert ("paint_6_2_1", "0.75 0.25 0.125") in paints  # red of 0.8 0.2 0.1
    used = re.findall(r"^usemtl (\S+)$", obj, re.MULTILINE)
    assert sorted(used) == sorted(name for name, _ in paints)
    assert obj.count("\nf ") == len(ball_shape("head").mesh.triangles)
