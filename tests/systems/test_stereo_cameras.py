"""Rendered cameras show the world where their cameras project it."""

import numpy as np
import pytest
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder

from nico_selfmodel.errors import RobotError
from nico_selfmodel.geometry.rotation import rotation_from_vector
from nico_selfmodel.geometry.transform import apply, transform
from nico_selfmodel.model.cameras.camera import Camera
from nico_selfmodel.model.cameras.stereo_rig import StereoRig
from nico_selfmodel.systems.image_values import bgr_of
from nico_selfmodel.systems.rendering.stereo_cameras import ImageQuality, StereoCameras
from nico_selfmodel.systems.tracking.shared_search import fiducial_detectors
from nico_selfmodel.vision.boards.chessboard import Board, find_chessboard
from nico_selfmodel.vision.images.not_seen import NotSeen

from .card_world import FIDUCIAL, CardWorld


def camera(dx=0.0, **lens):
    values = {"k1": -0.27, "k2": 0.085, "k3": -0.011, **lens}
    pose = transform(rotation_from_vector([0.01, dx, -0.01]), [0.7 * dx, 0.0, 0.0])
    return Camera(382.0, 380.0, 324.0, 236.0, (640, 480), X_WC=pose, **values)


RIG = StereoRig(camera(), camera(0.1))
FISHEYE = {"k1": 0.02, "k2": -0.01, "k3": 0.002, "k4": 0.0, "lens": "fisheye"}
RATIONAL = {"k1": 0.8, "k2": 0.12, "k3": 0.0, "k4": 1.1, "k5": 0.3, "k6": 0.0, "lens": "rational"}
RIGS = [RIG, *(StereoRig(camera(**lens), camera(0.1, **lens)) for lens in (FISHEYE, RATIONAL))]
SMALL = StereoRig(
    *(
        Camera(
            190.0, 190.0, 160.0, 119.0, (320, 240), k1=-0.2, X_WC=transform(np.eye(3), [x, 0, 0])
        )
        for x in (0.0, 0.07)
    )
)
BEFORE = transform(np.eye(3), [0.03, 0.0, 0.2])


def poses(rng, count, near, far, spread, tilt, inside, margin, rig=RIG):
    """Yield poses whose points both cameras see."""
    while count:
        z = rng.uniform(near, far)
        aside = rng.uniform(-spread, spread, 2) * z + [0.035, 0.0]
        X = transform(rotation_from_vector(rng.normal(0.0, tilt, 3)), [*aside, z])
        pixels = rig.project(apply(X, inside)) if inside.ndim == 2 else rig.project(X[:3, 3])[None]
        limit = np.array([640.0, 480.0] * 2) - margin
        if np.isfinite(pixels).all() and (pixels > margin).all() and (pixels < limit).all():
            count -= 1
            yield X, pixels


@pytest.mark.slow
def test_distorted_boards_are_where_the_camera_projects_them():
    board = Board(9, 6, 0.028)
    world = CardWorld(RIG, ImageQuality(noise=1.0), board)
    center = transform(np.eye(3), -board.points.mean(axis=0))
    rng, errors = np.random.default_rng(0), []
    centered = board.points - board.points.mean(axis=0)
    for k, (X, pixels) in enumerate(poses(rng, 4, 0.28, 0.4, 0.4, 0.3, centered, 15.0)):
        for side, image in enumerate(world.look(X @ center, float(k))):
            found = find_chessboard(image, board, 5)
            assert not isinstance(found, NotSeen), found
            errors.append(found.corners - pixels[:, 2 * side : 2 * side + 2])
    errors = np.concatenate(errors)
    assert np.sqrt(np.mean(np.sum(errors**2, axis=1))) < 0.12
    assert np.abs(errors.mean(axis=0)).max() < 0.02


@pytest.mark.slow
@pytest.mark.parametrize("rig", RIGS, ids=lambda rig: rig.lenses[0])
def test_marker_centres_behind_lenses_have_no_bias(rig):
    world = CardWorld(rig, ImageQuality(noise=2.0))
    find = fiducial_detectors({"card": FIDUCIAL}, rig=rig)["card"]
    rng, errors, missed = np.random.default_rng(1), [], 0
    shown = poses(rng, 100, 0.17, 0.33, 0.6, 0.45, np.zeros(3), 30.0, rig)
    for k, (X, pixels) in enumerate(shown):
        for side, image in enumerate(world.look(X, k / 30.0)):
            found = find[side](image)
            if isinstance(found, NotSeen):
                missed += 1
            else:
                errors.append(found - pixels[0, 2 * side : 2 * side + 2])
    errors = np.array(errors)
    assert missed < 20
    assert np.abs(errors.mean(axis=0)).max() <= 0.02
    assert np.sqrt(np.mean(np.sum(errors**2, axis=1))) <= 0.10


def test_noise_belongs_to_the_frame_and_the_seed():
    first, again = (CardWorld(SMALL, ImageQuality(1), seed=3) for _ in range(2))
    a, b = first.look(BEFORE, 1.0), again.look(BEFORE, 1.0)
    assert all(np.array_equal(x, y) for x, y in zip(a, b, strict=True))
    assert not np.array_equal(a[0], first.look(BEFORE, 1.0 + 1.0 / 30.0)[0])
    assert not np.array_equal(a[0], CardWorld(SMALL, ImageQuality(1), seed=4).look(BEFORE, 1.0)[0])


def test_noise_is_as_strong_as_asked_and_spares_the_background_colour():
    quiet = CardWorld(SMALL, ImageQuality(1, noise=0.0)).look(BEFORE)[0]
    noisy = CardWorld(SMALL, ImageQuality(1, noise=4.0)).look(BEFORE)[0]
    away = (noisy.astype(float) - quiet)[:40, 120:200]
    assert away.std() == pytest.approx(4.0, rel=0.05)
    assert away.mean() == pytest.approx(0.0, abs=0.1)


@pytest.mark.slow
def test_leaving_out_the_background_changes_nothing_to_see():
    world = CardWorld(SMALL, ImageQuality(2, noise=0.0))
    world.place(BEFORE)
    context = world.cameras.GetMyContextFromRoot(world.context)
    query = world.cameras.get_input_port().Eval(context)
    pinhole = world.cameras._StereoCameras__cameras[0]._pinhole
    window = pinhole._window(query)
    assert window != (0, 0, *pinhole.size)
    whole = pinhole._render(query, (0, 0, *pinhole.size)).astype(int)
    assert np.abs(pinhole(query) - whole).max() <= 2


def test_motion_blurs_what_moves_while_the_shutter_is_open():
    def width_of_edges(exposures):
        world = CardWorld(SMALL, ImageQuality(1, noise=0.0, exposures=exposures))
        world.place(BEFORE)
        simulator = Simulator(world.diagram, world.context)
        simulator.Initialize()
        for k in range(4):
            world.place(transform(np.eye(3), [0.03 + 0.004 * k, 0.0, 0.2]))
            simulator.AdvanceTo((k + 0.5) / 120.0)
        image = bgr_of(world.diagram.GetOutputPort("left").Eval(world.context))
        return np.abs(np.diff(image[:, :, 0].astype(float), axis=1)).max()

    assert width_of_edges(4) < 0.75 * width_of_edges(1)


def test_a_renderer_that_is_not_there_is_named():
    world = CardWorld(SMALL, ImageQuality(1), renderer="nothing")
    with pytest.raises((RobotError, RuntimeError), match="nothing"):
        world.look(BEFORE)


def test_cameras_that_are_not_connected_say_so():
    world = CardWorld(SMALL, ImageQuality(1))
    builder = DiagramBuilder()
    alone = builder.AddSystem(StereoCameras(SMALL, (world.frame, world.frame), ImageQuality(1)))
    builder.ExportOutput(alone.GetOutputPort("left_image"), "left")
    diagram = builder.Build()
    with pytest.raises(RobotError, match="geometry_query is not connected"):
        diagram.GetOutputPort("left").Eval(diagram.CreateDefaultContext())


@pytest.mark.parametrize(
    "changes", [{"supersample": 0}, {"noise": -1.0}, {"gain": 0.0}, {"fps": 0.0}, {"exposures": 0}]
)
def test_pictures_that_cannot_be_taken_are_refused(changes):
    with pytest.raises(ValueError, match=r"got|must"):
        ImageQuality(**changes)
