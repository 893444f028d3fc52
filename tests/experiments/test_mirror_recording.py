"""Nico before a mirror, recorded through rendered pixels."""

import numpy as np
import pytest

from nico_selfmodel.dataset.dataset import Dataset
from nico_selfmodel.dataset.folder import content_hash, load_dataset
from nico_selfmodel.dataset.joint_info import JointInfo
from nico_selfmodel.errors import EstimationError, ModelError
from nico_selfmodel.estimation.mirrors.mirror import calibrate_mirrors
from nico_selfmodel.model.cameras.mirror import Mirror
from nico_selfmodel.model.cameras.mirror_rig import MirrorRig
from nico_selfmodel.planning.mirror_poses import MirrorPoses, free_space
from nico_selfmodel.planning.mirror_view import MirrorView
from nico_selfmodel.sessions.camera_scenario import RenderedNico
from nico_selfmodel.sessions.mirrors import nico_before_mirrors
from nico_selfmodel.sessions.mirrors.mirror_scenario import held_out_rows
from nico_selfmodel.sessions.mirrors.nico_before_mirrors import (
    DEFAULT_MIRROR,
    NicoBeforeMirrors,
    mirror_of_words,
)
from nico_selfmodel.systems.rendering.mirror_scene import MirrorPlate
from nico_selfmodel.systems.rendering.stereo_cameras import ImageQuality

from ..true_nico import true_model

ROUGH = ImageQuality(1)


@pytest.fixture(scope="module")
def nico():
    return RenderedNico("clean", 3, ("fiducial",))


@pytest.fixture(scope="module")
def before(nico):
    return NicoBeforeMirrors(nico, {"glass": DEFAULT_MIRROR})


@pytest.fixture(scope="module")
def recording(before, tmp_path_factory):
    """Return a folder of a few poses, recorded in two sittings, and who recorded it."""
    folder = tmp_path_factory.mktemp("before") / "mirror"
    before.record("seen", 0, 3, 1, folder=folder)
    return folder, before


@pytest.mark.slow
def test_a_mirror_is_learned_from_the_hand_seen_in_it(nico, recording):
    folder, before = recording
    data = load_dataset(folder)
    reflected = data.select(data.mirror == "glass")
    assert np.isfinite(reflected.pixels).all(axis=1).sum() >= 3
    direct = data.select((data.mirror == "") & np.isfinite(data.pixels).all(axis=1))
    assert len(direct) >= 1
    model = true_model(nico.arm, "clean", 3)
    assert (
        np.abs(model.rig.project(model.predict(direct.encoders).p_WH) - direct.pixels).max() < 1.0
    )
    found = calibrate_mirrors(reflected, model)
    # Where the mirror was put by who thinks the head stands as designed.
    view = before.views["glass"]
    plane = found.mirrors["glass"].plane_in(model.rig.left.X_WC)
    assert abs(plane.distance_to(view.X_BM[:3, 3])) < 1.5e-3
    assert np.degrees(np.arccos(plane.normal @ -view.X_BM[:3, 2])) < 0.3
    assert found.solution.distances[~found.solution.outliers].mean() < 0.5


@pytest.mark.slow
def test_a_recording_before_a_mirror_can_be_resumed(recording):
    folder, before = recording
    first = load_dataset(folder)
    again = before.record("seen", 0, 3, 1, folder=folder)
    assert content_hash(again) == content_hash(first)
    assert set(again.mirror.tolist()) == {"", "glass"}


@pytest.mark.slow
def test_planned_poses_show_the_marker_in_the_glass_and_keep_off_it(nico, before):
    view, workspace = before.views["glass"], nico.workspace
    rig = MirrorRig(workspace.rig, DEFAULT_MIRROR)
    pixels = rig.project(workspace.arm.chain.forward(view.q))
    assert ((pixels > 59.0) & (pixels < np.array([640, 480, 640, 480]) - 60.0)).all()
    station = before.station(0)
    plan, where = before.plan(station, 5, 0, np.random.default_rng(0), best=True)
    assert where == ["glass"] * len(plan)
    assert len(plan) >= 5
    rng = np.random.default_rng(0)
    assert len(before.plan(station, 5, 0, rng, best=True, spare=4.0)[0]) > len(plan)
    guess = workspace.first_guess(station.joints)
    q = guess.servos.to_joint(np.array([command for _, command in plan]))
    assert free_space(guess.chain, rig, q).min() >= 0.05 - 1e-9


@pytest.mark.slow
@pytest.mark.parametrize("reached", [0, 3])
def test_a_mirror_before_which_few_poses_can_be_reached_does_with_these_where_it_may(
    before, monkeypatch, reached
):
    """Robot 1936 could reach three before one of twelve, and had learned no shape by it."""
    plan_poses = nico_before_mirrors.plan_mirror_poses

    def stuck(*args, **options):
        found = plan_poses(*args, **options)
        parts = (found.encoders, found.pixels, found.clearance, found.sigma)
        partial = MirrorPoses(*(part[:reached] for part in parts)) if reached else None
        raise EstimationError("no way", partial=partial)

    station, rng = before.station(0), np.random.default_rng(0)
    monkeypatch.setattr(nico_before_mirrors, "plan_mirror_poses", stuck)
    plan, where = before.plan(station, 5, 0, rng, best=True, least=0)
    assert len(plan) == len(where) == reached
    with pytest.raises(EstimationError, match="no way"):
        before.plan(station, 5, 0, rng, best=True)


@pytest.mark.slow
def test_the_station_before_a_mirror_has_three_ports_more_and_one_to_move_it(before):
    station = before.station(0)
    outputs = {station.get_output_port(i).get_name() for i in range(station.num_output_ports())}
    assert {"reflected_pixels", "reflected_seen", "reflected_reasons"} <= outputs
    assert station.HasInputPort("mirror_pose")
    assert all(f"`{port}`" in type(station).__doc__ for port in ("mirror_pose", "reflected_pixels"))


@pytest.mark.slow
def test_the_same_seed_before_the_same_mirror_is_the_same_to_the_last_byte():
    rough = RenderedNico("thesis", 4, ("fiducial",), ROUGH)
    pictures = []
    for _ in range(2):
        before = NicoBeforeMirrors(rough, {"m": DEFAULT_MIRROR})
        data = before.record("seen", 0, 1)
        pictures.append((content_hash(data), before.views["m"].X_BM.tobytes()))
    assert pictures[0] == pictures[1]


def test_a_mirror_in_which_nothing_can_be_seen_is_refused_by_name_of_a_better_place(nico):
    far = Mirror.from_values([0.0, 0.0, 3.0])
    with pytest.raises(ModelError, match="300 mm"):
        MirrorView.of(nico.workspace, far, MirrorPlate(), np.random.default_rng(0))


@pytest.mark.slow
def test_familiar_poses_are_preferred(recording):
    _, before = recording
    view = before.views["glass"]
    familiar = view.q[7:9] + 1e-6
    near = view.near(familiar, 5)
    assert len(near.q) == 5
    assert all((near.q == q).all(axis=1).any() for q in view.q[7:9])


def test_mirrors_are_read_from_the_command_line():
    name, mirror = mirror_of_words("near=280,5,-20")
    assert name == "near"
    assert mirror.values == pytest.approx([np.radians(5.0), np.radians(-20.0), 0.28])
    assert mirror_of_words("glass") == ("glass", DEFAULT_MIRROR)


@pytest.mark.parametrize("words", ["", "=300,0,0", "a=1,2", "a=0,0,0", "a=x,0,0", "a=nan,0,0"])
def test_words_that_are_no_mirror_are_refused(words):
    with pytest.raises(ValueError, match="--mirror"):
        mirror_of_words(words)


@pytest.mark.parametrize(("share", "first"), [(0.5, [1, 3, 5]), (0.25, [3, 7, 11])])
def test_poses_to_judge_by_lie_evenly_among_those_to_learn_from(share, first):
    samples = np.repeat(np.arange(40), 2)
    data = Dataset(
        "two rows a pose",
        (JointInfo("pan", "rad"),),
        samples,
        np.zeros((80, 1)),
        pixels=np.ones((80, 4)),
        marker=np.tile(["hand", "corner"], 40),
        image_size=(640, 480),
    )
    aside = held_out_rows(data, share)
    assert np.unique(samples[aside])[:3].tolist() == first
    assert aside.sum() == 80 * share
    assert not held_out_rows(data, 0.0).any()
