"""Spots of paint on a rendered Nico: seen in the mirror where they are, and gone when wiped off."""

from functools import cache

import numpy as np
import pytest
from pydrake.systems.analysis import Simulator

from nico_selfmodel.errors import RobotError
from nico_selfmodel.geometry.transform import apply
from nico_selfmodel.model.cameras.mirror_rig import MirrorRig
from nico_selfmodel.planning.plans import commands_of_angles
from nico_selfmodel.sessions.mirrors.nico_before_mirrors import DEFAULT_MIRROR, NicoBeforeMirrors
from nico_selfmodel.sessions.rendered_nico import RenderedNico
from nico_selfmodel.systems.rendering.mark_on_body import GLASS, Mark, recolored
from nico_selfmodel.systems.rendering.mirror_scene import MirrorPlate, put_mirror
from nico_selfmodel.systems.rendering.stereo_cameras import ImageQuality
from nico_selfmodel.systems.stations.nico_station import NicoStation
from nico_selfmodel.systems.stations.other_robot import OTHER
from nico_selfmodel.systems.stations.seen_surface import SeenSurface


@cache
def nico():
    return RenderedNico("thesis", 2, ("fiducial",), ImageQuality(2, noise=0.0))


RED = np.array([0.9, 0.1, 0.1])


@pytest.fixture(scope="module")
def before():
    """Return a station before a mirror, its context, and the mirror's true pose."""
    view = NicoBeforeMirrors(
        nico(), {"glass": DEFAULT_MIRROR}, plate=MirrorPlate("m", 1.4, 1.4)
    ).views["glass"]
    with NicoStation(
        "thesis", 2, arm=nico().arm, quality=nico().quality, mirror=view.plate, other=True
    ) as station:
        simulator = Simulator(station)
        context = simulator.get_mutable_context()
        command = commands_of_angles(
            station.joints, nico().arm.lower, nico().arm.upper, view.q[:1]
        )[0]
        for port in ("encoders_commanded", "other_commanded"):
            station.GetInputPort(port).FixValue(context, command)
        put_mirror(station, context, view.X_BM)
        simulator.AdvanceTo(1.5)
        yield station, context, view.X_BM, simulator


@pytest.fixture(scope="module")
def seen(before):
    """Return the surface as the cameras really see it."""
    station, context, X_BM, _ = before
    truth = station.ground_truth
    own = {k: v for k, v in station.surfaces_true(context).items() if not k.startswith(OTHER)}
    return SeenSurface(own, truth.rig, truth.mirror(X_BM).plane)


def changed(station, context, side, unmarked):
    """Return pixels (u, v) that differ clearly."""
    off = np.abs(station.picture(context, side).astype(int) - unmarked).max(axis=2)
    return np.argwhere(off > 20)[:, ::-1]


@pytest.mark.slow
def test_a_mark_is_seen_in_the_mirror_where_it_is_and_is_gone_when_wiped(before, seen):
    station, context, X_BM, _ = before
    unmarked = [station.picture(context, side) for side in ("left", "right")]
    places = seen.in_mirror(("head", "chest"), 3, np.random.default_rng(1))
    assert set(places.links) == {"head", "chest"}
    surfaces = station.surfaces_true(context)
    reflected = MirrorRig(station.ground_truth.rig, station.ground_truth.mirror(X_BM))
    for link, p_FQ in zip(places.links, places.p_FQ, strict=True):
        surface, X_LF = surfaces[link]
        assert abs(surface.distance(p_FQ[None])[0]) < 1e-4
        station.paint(context, Mark(link, p_FQ, 0.01, 1.0 - surface.color(p_FQ)))
        pixels = reflected.project(apply(X_LF, p_FQ[None])[0]).reshape(2, 2)
        for k, side in enumerate(("left", "right")):
            spots = changed(station, context, side, unmarked[k])
            assert 4 < len(spots) < 60
            assert np.linalg.norm(spots.mean(axis=0) - pixels[k]) < 1.0
        station.wipe(context)
    assert np.array_equal(station.picture(context, "left"), unmarked[0])


def narrowest(before, place, across):
    """Return how wide a disc looks in the mirror along its narrow side, by its rim [px]."""
    station, context, X_BM, _ = before
    link, p_FQ = place
    surface, X_LF = station.surfaces_true(context)[link]
    aside = np.linalg.svd(surface.normals(p_FQ[None]))[2][1:]
    turn = np.linspace(0.0, 2.0 * np.pi, 24, endpoint=False)
    rim = p_FQ + 0.5 * across * np.stack([np.cos(turn), np.sin(turn)], axis=1) @ aside
    rig = MirrorRig(station.ground_truth.rig, station.ground_truth.mirror(X_BM))
    pixels = np.array([rig.project(apply(X_LF, p[None])[0]) for p in rim])
    sides = (pixels[:, :2], pixels[:, 2:])
    return min(
        2.0 * np.linalg.svd(one - one.mean(axis=0))[1][1] / np.sqrt(0.5 * len(rim)) for one in sides
    )


@pytest.mark.slow
def test_a_disc_that_a_camera_sees_from_its_edge_counts_as_not_seen(before, seen):
    wide, all_of_them = (
        seen.in_mirror(("head", "chest"), 400, np.random.default_rng(4), across)
        for across in (0.01, 0.0)
    )
    least, widths = (
        [narrowest(before, place, 0.01) for place in zip(one.links, one.p_FQ, strict=True)]
        for one in (wide, all_of_them)
    )
    assert min(least) > 0.9
    assert 0 < sum(width < 0.9 for width in widths) < 0.1 * len(widths)
    assert len(least) > 0.9 * len(widths)


@pytest.mark.slow
def test_paint_of_the_surface_s_own_colour_is_not_to_be_seen(before):
    station, context, _, _ = before
    unmarked = station.picture(context, "left").astype(int)
    surface = station.surfaces_true(context)["head"][0]
    forehead = surface.along(np.array([[0.2, 0.0, 0.075]]), np.array([-1.0, 0.0, 0.0]))[0]
    station.paint(context, Mark("head", forehead, 0.01, surface.color(forehead)))
    same = station.picture(context, "left").astype(int)
    station.wipe(context)
    assert np.abs(same - unmarked).max() <= 6


@pytest.mark.slow
def test_a_mark_on_the_glass_moves_with_the_glass(before):
    station, context, X_BM, _ = before
    unmarked = station.picture(context, "left")
    p_MQ = np.array([0.01, -0.02, 0.0])
    station.paint(context, Mark(GLASS, p_MQ, 0.01, RED))
    truth = station.ground_truth
    pixel = truth.rig.left.project(apply(truth.X_LB @ X_BM, p_MQ[None])[0])
    spots = changed(station, context, "left", unmarked)
    station.wipe(context)
    assert len(spots) > 40
    assert np.linalg.norm(spots.mean(axis=0) - pixel) < 1.5


@pytest.mark.slow
def test_the_second_robot_can_be_marked_too(before):
    station, context, X_BM, _ = before
    X_WO = np.eye(4)
    X_WO[:2, 3] = -0.257, -0.306
    station.stand_other(context, X_WO)
    truth = station.ground_truth
    everything = station.surfaces_true(context)
    around = SeenSurface(everything, truth.rig, truth.mirror(X_BM).plane)
    places = around.in_mirror((f"{OTHER}head",), 1, np.random.default_rng(3))
    unmarked = station.picture(context, "left")
    station.paint(context, Mark(places.links[0], places.p_FQ[0], 0.01, RED))
    spots = changed(station, context, "left", unmarked)
    station.wipe(context)
    station.stand_other(context, None)
    assert len(spots) > 4


def test_a_step_of_colour_is_as_long_as_asked_for():
    rng = np.random.default_rng(4)
    for _ in range(20):
        found = recolored([0.97, 0.5, 0.1], 0.2, rng)
        assert np.linalg.norm(found - [0.97, 0.5, 0.1]) == pytest.approx(0.2)
        assert ((found >= 0.0) & (found <= 1.0)).all()
    with pytest.raises(ValueError, match="no colour is 3 from"):
        recolored([0.5, 0.5, 0.5], 3.0, rng)


@pytest.mark.slow
def test_what_cannot_be_painted_is_said(before):
    station, context, _, _ = before
    with pytest.raises(RobotError, match="nothing called 'tail' to paint; there are"):
        station.paint(context, Mark("tail", np.zeros(3), 0.01, RED))
    with pytest.raises(RobotError, match="head has no surface at"):
        station.paint(context, Mark("head", np.array([0.5, 0.0, 0.0]), 0.01, RED))
    with pytest.raises(ValueError, match="2 to 30 mm, got 50 mm"):
        Mark("head", np.zeros(3), 0.05, RED)
    with pytest.raises(ValueError, match="three numbers of 0 to 1"):
        Mark("head", np.zeros(3), 0.01, 2.0 * RED)
