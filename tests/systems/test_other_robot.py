"""A second robot before the first: seen where it stands, moved by its own commands."""

from functools import cache

import numpy as np
import pytest
from pydrake.systems.analysis import Simulator

from nico_selfmodel.errors import RobotError
from nico_selfmodel.estimation.contingency.motion_response import LITTLE, MUCH, STILL
from nico_selfmodel.geometry.transform import apply, transform
from nico_selfmodel.planning.motor_program import MotorProgram
from nico_selfmodel.planning.own_view import OwnArmInView
from nico_selfmodel.sessions.motion_session import Encounter, MotionSession
from nico_selfmodel.sessions.rendered_nico import RenderedNico
from nico_selfmodel.systems.looking import looking_body
from nico_selfmodel.systems.rendering.mirror_scene import MirrorPlate
from nico_selfmodel.systems.rendering.stereo_cameras import ImageQuality
from nico_selfmodel.systems.stations.nico_station import NicoStation

ROUGH = ImageQuality(1)
GAZE = np.radians(-40.0)
FACING = transform(
    np.array([[-np.cos(GAZE), np.sin(GAZE), 0], [-np.sin(GAZE), -np.cos(GAZE), 0], [0, 0, 1.0]]),
    [0.85 * np.cos(GAZE), 0.85 * np.sin(GAZE), 0.0],
)


@cache
def nico():
    return RenderedNico("thesis", 3, ("fiducial",), ROUGH)


@pytest.fixture(scope="module")
def station():
    with NicoStation(
        "thesis", 3, arm=nico().arm, quality=ROUGH, mirror=MirrorPlate(), other=True
    ) as one:
        yield one


def seen(station, X_WO, other=0.0):
    """Return the left picture with the second robot somewhere, moved by so many counts."""
    simulator = Simulator(station)
    context = simulator.get_mutable_context()
    still = np.array(station.GetOutputPort("encoders").Eval(context))
    station.GetInputPort("encoders_commanded").FixValue(context, still)
    station.GetInputPort("other_commanded").FixValue(context, still + other)
    station.stand_other(context, X_WO)
    simulator.AdvanceTo(0.5)
    return station.picture(context, "left").astype(int)


@pytest.mark.slow
def test_a_second_robot_is_seen_where_it_stands_and_moves_by_its_own_commands(station):
    away, there, moved = seen(station, None), seen(station, FACING), seen(station, FACING, 1500.0)
    changed = np.abs(there - away).max(axis=2) > 25
    assert 0.02 < changed.mean() < 0.5
    moving = np.abs(moved - there).max(axis=2) > 25
    assert 0.0005 < moving.mean() < changed.mean()


@pytest.mark.slow
def test_a_station_without_a_second_robot_says_so():
    with NicoStation("thesis", 3, arm=nico().arm, quality=ROUGH) as alone:
        with pytest.raises(RobotError, match="other=True"):
            alone.stand_other(alone.CreateDefaultContext(), FACING)
        assert not alone.HasInputPort("other_commanded")


@pytest.mark.slow
def test_cells_with_the_own_arm_hold_the_tracked_hand():
    truth = nico().ground_truth
    model = truth.model()
    own = OwnArmInView(nico().arm, model, model.rig.left, 16)
    with nico().station(0) as alone:
        plan = nico().plan(alone, 0, 6, np.random.default_rng(2))
    for _, command in plan:
        pixels = truth.expected([command])[0][0, :2]
        column, row = (pixels // 16).astype(int)
        cells = own.cells(command)
        assert cells[row, column]
        assert cells.mean() < 0.7


def test_an_arm_on_a_line_that_the_lens_does_not_show_still_reaches_into_the_picture(monkeypatch):
    model = nico().ground_truth.model()
    camera = model.rig.left
    own = OwnArmInView(nico().arm, model, camera, 16)
    shown = ~np.isnan(own._rays[:, :, 0])
    assert 0 < (~shown).sum() < 30
    last = int(np.flatnonzero(shown[29])[-1])  # the cell of the lowest row that is shown last
    ray = own._rays[29, last]
    aside = np.array([ray[0], ray[1], 0.0]) / np.hypot(*ray[:2])
    covered = {}
    for off in (0.02, 0.2):
        middle = apply(camera.X_WC, (0.12 * ray + off * aside)[None])
        assert np.isnan(camera.project(middle)).all()
        monkeypatch.setattr(own, "points", lambda _, p=middle: (p, np.array([0.026])))
        covered[off] = own.cells([])
        assert covered[off][~shown].all()  # nothing is seen there, nothing to judge
    assert covered[0.02][29, last]
    assert not covered[0.2][29, last]
    assert covered[0.02][shown].mean() < 0.05


def test_starts_and_stops_of_a_motor_program_have_no_memory():
    rng = np.random.default_rng(1)
    poses = rng.uniform(0.0, 1000.0, (30, 4))
    program = MotorProgram.random(poses, 300.0, rng)
    gaps = np.diff(program.times)
    assert np.corrcoef(gaps[:-1], gaps[1:])[0, 1] == pytest.approx(0.0, abs=0.15)
    assert (program.commands >= poses.min(axis=0) - 1e-9).all()
    assert (program.commands <= poses.max(axis=0) + 1e-9).all()
    late = program.later(0.3)
    assert len(late.due(0.2, 0.3)) == 1
    assert not late.due(0.0, 0.2)
    with pytest.raises(ValueError, match="two poses"):
        MotorProgram.random(poses[:1], 1.0, rng)
    for seconds in (0.0, -1.0, np.nan, np.inf):
        with pytest.raises(ValueError, match=r"lasts for more than 0 s, got .* s$"):
            MotorProgram.random(poses, seconds, rng)


def test_a_motor_program_is_the_same_in_any_unit():
    poses = np.random.default_rng(1).uniform(-20.0, 20.0, (30, 4))
    poses[:, 2] = 20.1  # is held
    units = (1.0, np.radians(1.0), 4096.0 / 360.0)
    drawn = [MotorProgram.random(k * poses, 60.0, np.random.default_rng(2)) for k in units]
    for program, k in zip(drawn, units, strict=True):
        assert np.array_equal(program.times, drawn[0].times)
        assert np.abs(program.commands / k - drawn[0].commands).max() < 1e-9
    ways = np.abs(np.diff(drawn[0].commands, axis=0) / np.maximum(np.ptp(poses, axis=0), 1e-9))
    assert ways.max(axis=1).mean() == pytest.approx(0.06, rel=0.3)


@pytest.mark.slow
def test_a_session_tells_when_encoders_and_image_move(station):
    model = nico().ground_truth.model()
    session = MotionSession(station, model, np.eye(4), GAZE, 0.07)
    rng = np.random.default_rng(4)
    with nico().station(0) as alone:
        poses = np.array([command for _, command in nico().plan(alone, 0, 8, rng)])
    watched = np.array(list(session.watch(Encounter("nobody"), poses, 1.2, rng)))
    moved, own, elsewhere = watched.T
    assert {STILL, MUCH} <= set(moved.tolist()) <= {STILL, LITTLE, MUCH}
    assert own.any()
    assert elsewhere.sum() <= 1  # noise moves a cell now and then


@pytest.mark.slow
@pytest.mark.parametrize("flashing", ["left", "right"])
def test_what_moves_before_either_camera_alone_is_noticed(station, monkeypatch, flashing):
    rng, calls = np.random.default_rng(5), {"left": 0, "right": 0}
    grey = np.full((480, 640, 3), 120.0)

    def picture(context, side):
        calls[side] += 1
        shown = grey + rng.normal(0.0, 2.0, grey.shape)
        if side == flashing and calls[side] % 2:
            # Two places, as the arm may cover one; the lens shows no corners.
            shown[:32, 160:192] += 60.0
            shown[-32:, 160:192] += 60.0
        return shown.astype(np.uint8)

    monkeypatch.setattr(station, "picture", picture)
    session = MotionSession(station, nico().ground_truth.model(), np.eye(4), GAZE, 0.07)
    with nico().station(0) as alone:
        poses = np.array([command for _, command in nico().plan(alone, 0, 8, rng)])
    watched = np.array(list(session.watch(Encounter("nobody"), poses, 0.6, rng)))
    assert watched[2:, 2].all()


@pytest.mark.slow
def test_a_second_robot_of_a_whole_body_is_seen_too():
    with NicoStation("thesis", 3, arm=looking_body(), quality=ROUGH, other=True) as whole:
        simulator = Simulator(whole)
        context = simulator.get_mutable_context()
        still = np.array(whole.GetOutputPort("encoders").Eval(context))
        for port in ("encoders_commanded", "other_commanded"):
            whole.GetInputPort(port).FixValue(context, still)
        away = whole.picture(context, "left").astype(int)
        whole.stand_other(context, FACING)
        changed = np.abs(whole.picture(context, "left").astype(int) - away).max(axis=2) > 25
        assert changed.mean() > 0.02
