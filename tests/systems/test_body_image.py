"""What a robot expects to see of itself, held against what it sees, directly and in a mirror."""

from dataclasses import replace
from functools import cache

import cv2
import numpy as np
import pytest
from pydrake.common.value import AbstractValue
from pydrake.systems.analysis import Simulator

from nico_selfmodel.errors import RobotError
from nico_selfmodel.estimation.mirrors.reflection_sigma import reflection_sigma
from nico_selfmodel.model.cameras.mirror import Mirror
from nico_selfmodel.model.cameras.mirror_rig import MirrorRig
from nico_selfmodel.planning.plans import commands_of_angles
from nico_selfmodel.sessions.mirrors.nico_before_mirrors import DEFAULT_MIRROR, NicoBeforeMirrors
from nico_selfmodel.sessions.rendered_nico import RenderedNico
from nico_selfmodel.systems.image_values import bgr_of
from nico_selfmodel.systems.rendering.body_image import NOTHING, BodyImage
from nico_selfmodel.systems.rendering.mirror_scene import MirrorPlate, put_mirror
from nico_selfmodel.systems.rendering.stereo_cameras import ImageQuality
from nico_selfmodel.systems.simulated.imperfections import imperfections_named
from nico_selfmodel.vision.images.image_array import bgr_of_rgba


@cache
def nico():
    return RenderedNico("clean", 2, ("fiducial",), ImageQuality(1, noise=0.0))


@cache
def true_model():
    return nico().ground_truth.model()


@pytest.fixture(scope="module")
def image():
    with BodyImage(nico().arm, true_model(), supersample=1) as one:
        yield one


@pytest.mark.slow
def test_colours_that_are_none_are_refused(image):
    for colors in (1.0 + image.paints, image.paints[:1]):
        with pytest.raises(ValueError, match="colors must"):
            image.paint(colors, np.zeros(len(image.paints)))


@pytest.mark.slow
def test_a_painted_body_is_expected_in_its_colours_and_where_it_was(image):
    readings = true_model().servos.to_encoder(0.5 * (nico().arm.lower + nico().arm.upper))
    before = image.expect(readings, DEFAULT_MIRROR, 0)
    shirt = int(np.argmin(np.abs(image.paints - [0.18, 0.48, 0.55]).sum(axis=1)))
    colors, sigma = image.paints.copy(), np.zeros(len(image.paints))
    colors[shirt] *= [0.5, 1.0, 1.0]
    try:
        image.paint(colors, sigma)
        after = image.expect(readings, DEFAULT_MIRROR, 0)
        chest = image.surfaces["chest"]
    finally:
        image.paint(image.paints, sigma)
    # Where two shapes coincide, which of them is drawn depends on their order.
    assert np.mean(before.labels != after.labels) < 1e-3
    assert np.mean(before.paints != after.paints) < 1e-3
    assert (before.paints[before.labels == NOTHING] == -1).all()
    assert (before.paints[before.labels != NOTHING] >= 0).all()
    own = cv2.erode((before.paints == shirt).astype(np.uint8), np.ones((5, 5))) > 0
    assert own.sum() > 500
    shares = after.color[own, :3] / np.maximum(before.color[own, :3].astype(float), 1.0)
    assert np.median(shares, axis=0) == pytest.approx([0.5, 1.0, 1.0], abs=0.02)
    assert any(np.array_equal(color, colors[shirt]) for color in chest.colors)
    again = image.expect(readings, DEFAULT_MIRROR, 0)
    assert np.mean(again.color != before.color) < 1e-3


def looked(robot):
    """Return the true mirror, readings, and what both cameras see in a large one."""
    before = NicoBeforeMirrors(robot, {"glass": DEFAULT_MIRROR}, plate=MirrorPlate("m", 1.4, 1.4))
    view = before.views["glass"]
    with before.station(0) as station:
        simulator = Simulator(station)
        context = simulator.get_mutable_context()
        command = commands_of_angles(station.joints, robot.arm.lower, robot.arm.upper, view.q[:1])[
            0
        ]
        station.GetInputPort("encoders_commanded").FixValue(context, command)
        put_mirror(station, context, view.X_BM)
        simulator.AdvanceTo(2.5)
        readings = np.array(station.GetOutputPort("encoders").Eval(context))
        pictures = [station.picture(context, side) for side in ("left", "right")]
    return robot.ground_truth.mirror(view.X_BM), readings, pictures


@pytest.fixture(scope="module")
def look():
    return looked(nico())


@pytest.mark.slow
def test_the_same_look_is_not_rendered_anew_whatever_was_asked_in_between(image):
    lower, upper = true_model().servos.to_encoder(np.array([nico().arm.lower, nico().arm.upper]))
    one, other = 0.6 * lower + 0.4 * upper, 0.4 * lower + 0.6 * upper
    image.poses(one)
    stood = image.standing(image.joints)
    seen = image.expect(one, DEFAULT_MIRROR, 0)
    image.poses(other)
    image.expect(other, DEFAULT_MIRROR, 1)
    assert image.expect(one, DEFAULT_MIRROR, 0) is seen
    # Joints stand where the picture has them, which was not rendered.
    for before, now in zip(stood, image.standing(image.joints), strict=True):
        np.testing.assert_array_equal(now.p_WJ, before.p_WJ)
        assert now.angle == before.angle
    assert image.expect(other, DEFAULT_MIRROR, 0) is not seen


@pytest.mark.slow
def test_papered_walls_show_in_a_mirror_behind_the_body_and_change_nothing_of_it(image, look):
    papered = replace(imperfections_named("clean"), papered=True)
    mirror, readings, pictures = looked(
        RenderedNico(papered, 2, ("fiducial",), ImageQuality(1, noise=0.0))
    )
    for side, (picture, before) in enumerate(zip(pictures, look[2], strict=True)):
        labels = image.expect(readings, mirror, side).labels
        still = (labels != NOTHING) & ~np.isin(labels, list(image.moving))
        parts = [one.astype(np.uint8) for one in (still, labels == NOTHING)]
        inside, beside = (cv2.erode(one, np.ones((9, 9))) > 0 for one in parts)
        apart = np.abs(picture.astype(float) - before)[inside].max(axis=1)
        assert np.mean(apart <= 2.0) > 0.99  # but where the arm is not as it is expected
        assert picture[beside].std(axis=0).min() > 20.0


@pytest.mark.slow
def test_who_knows_itself_sees_in_a_mirror_what_it_expects(image, look):
    mirror, readings, pictures = look
    for side, picture in enumerate(pictures):
        seen = image.expect(readings, mirror, side)
        own = (seen.labels != NOTHING) & ~np.isin(seen.labels, list(image.moving))
        assert own.sum() > 10000
        off = bgr_of_rgba(seen.color).astype(float)[own] * 0.93 - picture[own]
        assert np.median(np.abs(off)) < 2.0
        assert np.mean(np.abs(off).max(axis=1) < 12.0) > 0.85


@pytest.mark.slow
def test_the_hand_is_expected_where_its_link_is_projected_and_as_far_away(image, look):
    mirror, readings, _ = look
    p_WH = true_model().points(true_model().servos.to_joint(readings))
    reflected = MirrorRig(true_model().rig, mirror)
    for side in range(2):
        seen = image.expect(readings, mirror, side)
        u, v = np.round(reflected.project(p_WH)[2 * side : 2 * side + 2]).astype(int)
        assert image.links[int(seen.labels[v, u])] in {"right_hand", "right_hand_fiducial"}
        camera = reflected.virtual.cameras[side]
        depth = (camera.X_CW[:3, :3] @ p_WH + camera.X_CW[:3, 3])[2]
        assert seen.depth[v, u] == pytest.approx(depth, abs=0.01)


@pytest.mark.slow
def test_ports_carry_what_is_expected(image, look):
    mirror, readings, _ = look
    context = image.CreateDefaultContext()
    image.GetInputPort("encoders").FixValue(context, readings)
    direct = np.array(image.GetOutputPort("left_link").Eval(context).data)[:, :, 0]
    assert np.array_equal(direct, image.expect(readings, None, 0).labels)
    image.GetInputPort("mirror").FixValue(context, AbstractValue.Make(mirror))
    seen = image.expect(readings, mirror, 1)
    assert np.array_equal(
        bgr_of(image.GetOutputPort("right_image_expected").Eval(context)), bgr_of_rgba(seen.color)
    )
    assert np.array_equal(
        image.GetOutputPort("right_depth").Eval(context).data[:, :, 0], seen.depth
    )
    labels = image.GetOutputPort("right_link").Eval(context).data[:, :, 0]
    assert (labels != NOTHING).sum() > (direct != NOTHING).sum()


@pytest.mark.slow
def test_the_sigma_of_a_reflection_is_how_far_it_scatters(image, look):
    true, readings, _ = look
    covariance = np.diag(np.square([2e-3, 1e-3, 1e-3]))
    mirror = Mirror.from_values(true.values, covariance)
    p_WH = true_model().points(true_model().servos.to_joint(readings))
    u, v = np.round(MirrorRig(true_model().rig, mirror).project(p_WH)[:2]).astype(int)
    depth = image.expect(readings, mirror, 0).depth
    sigma = reflection_sigma(true_model().rig, mirror, 0, depth, 2e-3)[v, u]
    rng = np.random.default_rng(1)
    values = rng.multivariate_normal(mirror.values, covariance, 400)
    points = p_WH + 2e-3 * rng.standard_normal((400, 3))
    pixels = np.array(
        [
            MirrorRig(true_model().rig, Mirror.from_values(m)).project(p)[:2]
            for m, p in zip(values, points, strict=True)
        ]
    )
    scatter = np.sqrt(0.5 * np.trace(np.cov(pixels.T)))
    # Rounded up to a sixteenth of a pixel.
    assert scatter * 0.92 < sigma < scatter * 1.08 + 0.0625
    assert np.isnan(
        reflection_sigma(true_model().rig, mirror, 0, np.full((480, 640), np.inf), 1e-3)
    ).all()


@pytest.mark.slow
def test_a_closed_expectation_says_so(look):
    _, readings, _ = look
    image = BodyImage(nico().arm, true_model(), supersample=1)
    image.close()
    with pytest.raises(RobotError, match="was closed"):
        image.expect(readings, None, 0)
