"""Whose cameras a robot at work may be watched with."""

from dataclasses import replace

import numpy as np
import pytest

from nico_selfmodel.errors import ModelError
from nico_selfmodel.geometry.plane import Plane
from nico_selfmodel.model.tree.standing_mirror import StandingMirror
from nico_selfmodel.planning.body_before_mirror import BodyBeforeMirror
from nico_selfmodel.sessions.mirrors.nico_before_mirrors import DEFAULT_MIRROR
from nico_selfmodel.sessions.watching import Watching
from nico_selfmodel.sessions.watching_body import WatchingBody
from nico_selfmodel.sessions.whole_recording import WholeRecording
from nico_selfmodel.systems.looking import looking_arm
from nico_selfmodel.systems.rendering.mirror_scene import MirrorPlate
from nico_selfmodel.systems.simulated.imperfections import IMPERFECTIONS
from nico_selfmodel.viz.scene.scene import ROOT

from ..true_nico import true_body, true_model

ARM = looking_arm("fiducial")


def test_a_body_that_learned_with_its_head_turned_elsewhere_is_refused():
    held = {**ARM.held, "neck_yaw": ARM.held["neck_yaw"] + 0.1}
    model = replace(true_model(ARM, "clean", 3), robot={**ARM.source, "held": held})
    with pytest.raises(ModelError, match=r"learned with neck_yaw at .* deg, and this Nico"):
        Watching(model, IMPERFECTIONS["clean"], 3)


@pytest.mark.slow
def test_a_whole_body_that_knows_itself_expects_its_hand_and_the_room_where_they_are_seen():
    model = true_body("clean", 3)
    with WatchingBody(model, IMPERFECTIONS["clean"], 3, recording=True) as watching:
        shown = watching.visit_random_poses(2)
        page = watching.view.html()
        followed = []
        watching.run(followed.append, 0.2)
    assert set(shown[0]) == {"right hand", "left hand", "room"}
    seen = np.array([error for one in shown for error in one.values()])
    assert np.isfinite(seen).any(axis=0).all()
    assert np.nanmax(seen) < 1.0
    assert followed[0].keys() == shown[0].keys()
    assert page.lstrip().lower().startswith("<!doctype html>")


def before_glass(world, seed):
    """A body that knows itself exactly, and the mirror that is put before it."""
    body, whole = true_body(world, seed), WholeRecording()
    size, hands = (MirrorPlate().width, MirrorPlate().height), list(whole.hands.values())
    rng = np.random.default_rng(0)
    plane = BodyBeforeMirror.of(whole.view, DEFAULT_MIRROR, size, hands, rng).glass.plane
    return replace(body, tree=body.tree.with_mirrors((StandingMirror("glass", plane),))), plane


@pytest.mark.slow
def test_a_whole_body_before_its_mirror_expects_its_hands_where_it_sees_them_in_it():
    model, _ = before_glass("clean", 3)
    mirror = ("glass", None)
    with WatchingBody(model, IMPERFECTIONS["clean"], 3, mirror=mirror, recording=True) as watching:
        shown = watching.visit_random_poses(6)
        page = watching.view.html()
        paths = ["mirror/glass", "mirror/right hand/left_ray", "reflections/left hand/tracked"]
        assert all(watching.view.meshcat.HasPath(f"{ROOT}/{path}") for path in paths)
    in_mirror = np.array([[one[f"{side} hand in the mirror"] for side in ("right", "left")]
                          for one in shown])  # fmt: skip
    assert np.isfinite(in_mirror).any(axis=(0, 2)).all()
    assert np.nanmax(in_mirror) < 1.0
    assert page.lstrip().lower().startswith("<!doctype html>")


@pytest.mark.slow
def test_a_mirror_that_stood_elsewhere_or_is_not_known_is_not_shown():
    model, plane = before_glass("clean", 3)
    moved = Plane(plane.normal, plane.offset + 0.06)
    other = replace(model, tree=model.tree.with_mirrors((StandingMirror("glass", moved),)))
    with pytest.raises(ModelError, match=r"'glass' was learned 0 deg and 60 mm from where it is"):
        WatchingBody(other, IMPERFECTIONS["clean"], 3, mirror=("glass", None))
    with pytest.raises(ValueError, match="no mirror 'wall'; the body knows glass"):
        WatchingBody(model, IMPERFECTIONS["clean"], 3, mirror=("wall", None))


def test_a_body_that_does_not_know_the_markers_of_its_hands_is_not_shown():
    model = true_body("clean", 3)
    tree = model.tree.with_markers(model.tree.markers[4:])
    with pytest.raises(ModelError, match=r"not know the markers right_hand_fiducial_0, .* --head"):
        WatchingBody(replace(model, tree=tree), IMPERFECTIONS["clean"], 3)
