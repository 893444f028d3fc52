"""A diagram that watches its own body."""

from dataclasses import dataclass, replace

import numpy as np
import pytest
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import ConstantVectorSource

from nico_selfmodel.errors import ModelError
from nico_selfmodel.estimation.arm.kinematics import calibrate_kinematics
from nico_selfmodel.estimation.body.body import calibrate_body
from nico_selfmodel.estimation.monitoring.health import check_health
from nico_selfmodel.experiments.projected_nico import ProjectedNico
from nico_selfmodel.experiments.refinement import simulated_scenario
from nico_selfmodel.systems.simulated.imperfections import IMPERFECTIONS
from nico_selfmodel.systems.tracking.self_model_monitor import SelfModelMonitor

from ..estimation.sagging_arms import SaggingArm

PERIOD = 0.1


@pytest.fixture(scope="module")
def case():
    world = IMPERFECTIONS["clean"].with_noise(play_deg=0.5)
    protocol = ProjectedNico.tracked_by()
    scenario = simulated_scenario(protocol, world, 0, random_poses=40)
    model = calibrate_body(scenario.train, scenario.cameras, scenario.boards).model
    return protocol, world, model


def poses(case, count, slip=0.0, seed=1, observed=False):
    protocol, world, _ = case
    body = protocol.robot(world, 0, session=seed)
    if slip:
        body.faults.slip("right_shoulder_roll", slip)
    q = protocol.random_poses(count, np.random.default_rng(seed))
    return protocol.record(body, "poses", q, observed=observed)


@dataclass(frozen=True)
class Shown:
    """What ports carry, which a data set cannot hold."""

    encoders: np.ndarray
    pixels: np.ndarray

    def __len__(self):
        return len(self.encoders)


def watch(monitor, data, column="pixels"):
    """Show rows to a monitor, one a period; return its outputs after each."""
    context = monitor.CreateDefaultContext()
    simulator = Simulator(monitor, context)
    outputs = []
    seen = data.pixels if column == "pixels" else data.p_WH_measured
    for i in range(len(data)):
        monitor.GetInputPort("encoders").FixValue(context, data.encoders[i])
        monitor.GetInputPort(column).FixValue(context, seen[i])
        simulator.AdvanceTo(PERIOD * (i + 0.5))
        names = ("nis", "log_ratio", "alarm")
        values = [monitor.GetOutputPort(name).Eval(context)[0] for name in names]
        outputs.append((*values, monitor.GetOutputPort("cause").Eval(context)))
    return outputs, context


@pytest.mark.slow
def test_it_says_what_the_check_of_a_recording_says(case):
    model, data = case[2], replace(poses(case, 20), pixel_sigma_px=None)
    outputs, _ = watch(SelfModelMonitor(model, PERIOD), data)
    report = check_health(model, data)
    nis, log_ratio, alarm, cause = zip(*outputs, strict=True)
    assert np.array(nis) == pytest.approx(report.nis)
    assert np.array(log_ratio) == pytest.approx(report.log_ratio)
    assert not any(alarm)
    assert set(cause) == {""}


@pytest.mark.slow
def test_a_slip_raises_the_alarm_and_its_cause_becomes_clear(case):
    model = case[2]
    outputs, _ = watch(SelfModelMonitor(model, PERIOD), poses(case, 14, np.radians(3.0)))
    alarms = [alarm for *_, alarm, _ in outputs]
    assert 1.0 in alarms[:4]
    first = alarms.index(1.0)
    assert all(alarms[first:])
    assert outputs[first - 1][-1] == ""
    assert outputs[-1][-1] == "zero of right_shoulder_roll"


@pytest.mark.slow
def test_it_forgets_the_oldest_poses_and_keeps_the_cause(case, monkeypatch):
    """More poses after the alarm than are kept: what changed stays the same."""
    monkeypatch.setattr("nico_selfmodel.systems.tracking.self_model_monitor.REMEMBERED", 25)
    model = case[2]
    monitor = SelfModelMonitor(model, PERIOD)
    outputs, context = watch(monitor, poses(case, 40, np.radians(3.0)))
    state = monitor.state_of(context)
    assert len(state.recent) == 25
    assert state.since == 0
    assert outputs[-1][-1] == "zero of right_shoulder_roll"


@pytest.mark.slow
def test_backlash_is_seen_by_the_side_from_which_joints_come():
    rng = np.random.default_rng((3, 93))
    arm = SaggingArm.drawn(rng, sag=0.0, backlash=0.4)
    train, _ = arm.recorded(rng, 60)
    model = calibrate_kinematics(train, explain=False).model
    data, _ = arm.recorded(rng, 40)
    told, _ = watch(SelfModelMonitor(model, PERIOD), data, "p_WH_measured")
    report = check_health(model, data)
    # What comes before the first pose the monitor cannot know.
    nis = np.array([row[0] for row in told])
    assert nis[1:] == pytest.approx(report.nis[1:], rel=1e-6)
    assert not any(row[2] for row in told)
    assert nis[1:].mean() == pytest.approx(3.0, abs=1.2)
    # From the other sides the hand would be elsewhere.
    turned = check_health(model, replace(data, approach=-data.approach))
    assert turned.nis[1:].mean() > 10.0 * nis[1:].mean()


@pytest.mark.slow
def test_contexts_remember_for_themselves(case):
    monitor = SelfModelMonitor(case[2], PERIOD)
    watch(monitor, poses(case, 6, np.radians(5.0)))
    outputs, context = watch(monitor, poses(case, 6))
    assert not any(alarm for *_, alarm, _ in outputs)
    assert monitor.state_of(context).monitor.poses == 6


@pytest.mark.slow
def test_a_hand_that_is_not_seen_is_no_detection(case):
    data = poses(case, 6)
    pixels = data.pixels.copy()
    pixels[2] = np.nan
    pixels[4, 2:] = np.nan
    monitor = SelfModelMonitor(case[2], PERIOD)
    outputs, context = watch(monitor, replace(data, pixels=pixels))
    assert np.isnan(outputs[2][0])
    assert outputs[2][1] == outputs[1][1]
    assert np.isfinite(outputs[4][0])
    assert monitor.state_of(context).monitor.poses == 5


def test_a_joint_that_is_not_read_is_no_detection_and_ends_nothing(case):
    data = poses(case, 6)
    encoders = data.encoders.copy()
    encoders[0, 1] = encoders[3, 2] = np.nan
    monitor = SelfModelMonitor(case[2], PERIOD)
    outputs, context = watch(monitor, data=Shown(encoders, data.pixels))
    assert np.isnan([outputs[0][0], outputs[3][0]]).all()
    assert np.isfinite([outputs[k][0] for k in (1, 2, 4, 5)]).all()
    state = monitor.state_of(context)
    assert state.monitor.poses == 4
    # The joint that was lost at first is watched from the next pose on.
    assert (state.sides.side != 0.0).all()


def test_a_model_without_cameras_watches_points(case):
    model = case[2]
    names = [n for n in model.covariance.names if not n.startswith(("left.", "right."))]
    own = [model.covariance.names.index(n) for n in names]
    known = replace(
        model.covariance,
        names=tuple(names),
        matrix=model.covariance.matrix[np.ix_(own, own)],
    )
    unobservable = replace(model, cameras={}, covariance=known, pixel_sigma=None)
    monitor = SelfModelMonitor(unobservable, PERIOD)
    assert monitor.GetInputPort("p_WH_measured").size() == 3
    data = poses(case, 8, np.radians(4.0), observed=True)
    outputs, _ = watch(monitor, replace(data, pixels=None), "p_WH_measured")
    assert outputs[-1][2] == 1.0


@pytest.mark.slow
def test_it_stands_in_a_diagram(case):
    builder = DiagramBuilder()
    monitor = builder.AddSystem(SelfModelMonitor(case[2], PERIOD))
    data = poses(case, 1)
    for port, value in (("encoders", data.encoders[0]), ("pixels", data.pixels[0])):
        source = builder.AddSystem(ConstantVectorSource(value))
        builder.Connect(source.get_output_port(), monitor.GetInputPort(port))
    builder.ExportOutput(monitor.GetOutputPort("alarm"), "alarm")
    diagram = builder.Build()
    simulator = Simulator(diagram)
    simulator.AdvanceTo(0.35)
    assert diagram.GetOutputPort("alarm").Eval(simulator.get_context())[0] == 0.0
    state = monitor.state_of(monitor.GetMyContextFromRoot(simulator.get_context()))
    assert state.monitor.poses == 4


@pytest.mark.slow
def test_what_it_cannot_watch_is_refused(case):
    model = case[2]
    with pytest.raises(ModelError, match="does not say how well"):
        SelfModelMonitor(replace(model, covariance=None))
    untold = {key: value for key, value in model.fit.items() if key != "noise"}
    with pytest.raises(ModelError, match="what noise its training left"):
        SelfModelMonitor(replace(model, fit=untold))
    with pytest.raises(ValueError, match="period must be positive"):
        SelfModelMonitor(model, 0.0)
    with pytest.raises(ValueError, match="no marker 'thumb'"):
        SelfModelMonitor(model, PERIOD, "thumb")
