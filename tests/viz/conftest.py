"""Calibrations of a simulated arm: one that is good, one that must fail, one of circles alone."""

from dataclasses import replace
from unittest import mock

import numpy as np
import pytest

from nico_selfmodel.dataset.dataset import Dataset
from nico_selfmodel.dataset.joint_info import JointInfo
from nico_selfmodel.estimation.arm.kinematics import calibrate_kinematics
from nico_selfmodel.estimation.judging import judge, to_json
from nico_selfmodel.model.arm.chain import Chain
from nico_selfmodel.model.arm.servo_map import ServoMap
from nico_selfmodel.viz.reports.arm import arm_report
from nico_selfmodel.viz.reports.cameras import camera_report

from . import seen_boards

JOINTS = ("pitch", "roll", "twist", "elbow")
OUTLIERS = (7, 45)


def true_arm():
    """Return an arm of the size of Nico's, in a measuring frame some way off."""
    shoulder = np.array([0.5, 0.35, 0.42])
    directions = np.array([[0, 1, 0], [1, 0.05, 0], [0.03, 0, 1], [0.05, 1, 0.1]], dtype=float)
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    offsets = [[0, 0, 0], [0.002, -0.03, 0], [0, -0.03, -0.06], [0.004, -0.03, -0.13]]
    hand = shoulder + np.array([0.137, -0.035, -0.1])
    return Chain(JOINTS, directions, shoulder + np.array(offsets), ("hand",), hand[None])


def poses(sweep_points, random_poses, rng):
    """Return joint angles and the sweep column: home, one sweep a joint, free poses."""
    limit = np.array([1.0, 0.8, 1.1, 0.9])
    angles, sweep = [np.zeros(4)], ["home"]
    for j, joint in enumerate(JOINTS):
        for angle in np.linspace(-limit[j], limit[j], sweep_points):
            angles.append(np.where(np.arange(4) == j, angle, 0.0))
            sweep.append(joint)
    angles += list(rng.uniform(-limit, limit, (random_poses, 4)))
    return np.array(angles), np.array(sweep + [""] * random_poses)


def recorded(name, q, sweep, rng, outliers=()):
    """Return what encoders and a tracker with 0.5 mm of noise make of poses."""
    servos = ServoMap(
        JOINTS,
        offset=np.array([0.3, -0.8, 0.2, 1.0]),
        gear=np.array([1.0, 1.0, 1.0, 2.5]),
        unit=("counts",) * 4,
        counts_per_turn=np.full(4, 40000.0),
        sign=np.ones(4),
    )
    points = true_arm().forward(q) + 5e-4 * rng.standard_normal((len(q), 3))
    for row in outliers:
        points[row] += [0.05, -0.04, 0.03]
    return Dataset(
        name=name,
        joints=tuple(JointInfo(joint, "counts", 40000.0) for joint in JOINTS),
        sample=np.arange(len(q)),
        encoders=np.round(servos.to_encoder(q)),
        p_WH_measured=points,
        sweep=sweep,
        point_sigma_m=5e-4,
    )


@pytest.fixture(scope="session")
def held_out():
    rng = np.random.default_rng(8)
    q, sweep = poses(1, 25, rng)
    return recorded("held-out", q[5:], sweep[5:], rng)


@pytest.fixture(scope="session")
def training():
    rng = np.random.default_rng(7)
    return recorded("sweeps", *poses(9, 40, rng), rng, OUTLIERS)


@pytest.fixture(scope="session")
def calibration(training, held_out):
    """A good calibration, with two outliers and held-out data."""
    return calibrate_kinematics(training, test=held_out)


@pytest.fixture(scope="session")
def failed(held_out):
    """A calibration from data in which the elbow hardly moved, so that directions stay open."""
    rng = np.random.default_rng(3)
    q, sweep = poses(7, 12, rng)
    q[:, 3] *= 0.003
    scarce = recorded("too <b>little</b> `data`", q, sweep, rng)
    return calibrate_kinematics(scarce, test=held_out, starts=2)


@pytest.fixture(scope="session")
def circles_alone(training):
    """A calibration by circle point analysis, with nothing held out."""
    return calibrate_kinematics(training, method="circle-points")


@pytest.fixture(scope="session")
def grid():
    """A two-joint arm on an unmarked grid of poses, so that circles lie at many postures."""
    rng = np.random.default_rng(5)
    directions = np.array([[0.0, 0.0, 1.0], [0.0, 1.0, 0.0]])
    points = np.array([[0.3, 0.1, 0.2], [0.3, 0.1, 0.4]])
    chain = Chain(("pan", "tilt"), directions, points, ("lamp",), np.array([[0.6, 0.1, 0.4]]))
    pan, tilt = np.meshgrid(np.linspace(-1.0, 1.0, 6), np.linspace(-0.7, 0.5, 5), indexing="ij")
    q = np.stack([pan.ravel(), tilt.ravel()], axis=1)
    measured = chain.forward(q) + 1e-4 * rng.standard_normal((len(q), 3))
    joints = (JointInfo("pan", "rad"), JointInfo("tilt", "deg"))
    data = Dataset(
        name="grid",
        joints=joints,
        sample=np.arange(len(q)),
        encoders=q * [1.0, 180.0 / np.pi],
        p_WH_measured=measured,
        marker=np.full(len(q), "lamp"),
        point_sigma_m=1e-4,
    )
    return calibrate_kinematics(data)


@pytest.fixture(scope="session")
def renamed(training):
    """The same data, with names that a page or a path must not stumble over."""
    nasty = ("a<b>", "a/b", "a b", '$x_1$ & "y"')
    joints = tuple(
        replace(info, name=name) for info, name in zip(training.joints, nasty, strict=True)
    )
    new = dict(zip(JOINTS, nasty, strict=True))
    sweep = np.array([new.get(name, name) for name in training.sweep.tolist()])
    marker = np.full(len(training), "<i>hand</i>")
    data = replace(
        training, name="<script>alert(1)</script>", joints=joints, sweep=sweep, marker=marker
    )
    return calibrate_kinematics(data)


@pytest.fixture(scope="session")
def verdict(calibration):
    return judge(calibration)


@pytest.fixture(scope="session")
def document(calibration, verdict):
    return to_json(calibration, verdict)


@pytest.fixture(scope="session")
def html(calibration, document):
    """The report of the good calibration, with all its figures."""
    return arm_report(calibration, document).html()


@pytest.fixture(scope="session")
def failed_html(failed):
    """The report of the failed calibration, with empty figures: those are drawn elsewhere."""
    verdict = judge(failed)
    assert verdict.status == "FAIL"
    with mock.patch("nico_selfmodel.viz.figures.plot_style.image_bytes", return_value=b"<svg/>"):
        return arm_report(failed, to_json(failed, verdict)).html()


@pytest.fixture(scope="session")
def cameras():
    """A good calibration of two cameras, with boards held out."""
    return seen_boards.assessed(*seen_boards.boards(14).split(0.3, 0))


@pytest.fixture(scope="session")
def flawed_cameras():
    """Two cameras that saw an outlier and lost corners, with nothing held out."""
    return seen_boards.assessed(seen_boards.flawed(seen_boards.boards(12)))


@pytest.fixture(scope="session")
def one_camera():
    """The right camera alone."""
    return seen_boards.assessed(seen_boards.boards(8).only("right"))


@pytest.fixture(scope="session")
def photographs(cameras):
    """Photographs of all views, and of one in which no board was found."""
    views = cameras.calibration.views.names + cameras.test_views.names
    return seen_boards.photographs((*views, seen_boards.UNSEEN))


@pytest.fixture(scope="session")
def camera_result(cameras, photographs):
    """The content of `result.json` for the good cameras, with what is known of their files."""
    files = {
        camera: {name: f"{camera}{name}.jpg" for name in photographs[camera]}
        for camera in photographs
    }
    tried = {f"right{seen_boards.UNSEEN}.jpg": "no 5x4 board, <b>whatever</b> was tried"}
    detection = {"board": "5x4", "square_mm": 30.0, "files": files, "not_seen": tried}
    return to_json(cameras, judge(cameras)) | {"detection": detection}


@pytest.fixture(scope="session")
def camera_html(cameras, camera_result, photographs):
    """The report on the good cameras, with all its figures."""
    model = cameras.calibration.self_model("my <i>cameras</i>", {"images": "boards"})
    return camera_report(cameras, camera_result, photographs, model).html()
