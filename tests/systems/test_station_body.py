"""Driving a station through its ports: settling, sampling, and what can go wrong."""

from dataclasses import replace

import numpy as np
import pytest
from pydrake.systems.framework import BasicVector, DiagramBuilder, LeafSystem
from pydrake.systems.primitives import ConstantVectorSource, PassThrough

from nico_selfmodel.dataset.joint_info import JointInfo
from nico_selfmodel.errors import RobotError
from nico_selfmodel.model.arm.chain import Chain
from nico_selfmodel.model.arm.servo_map import ServoMap
from nico_selfmodel.systems.simulated.encoder_model import EncoderModel
from nico_selfmodel.systems.simulated.imperfections import IMPERFECTIONS
from nico_selfmodel.systems.simulated.mechanics import Mechanics
from nico_selfmodel.systems.stations.station_body import SettleTimeouts, StationBody

JOINTS = tuple(JointInfo(name, "counts", 4096.0, -800.0, 900.0) for name in ("base", "tip"))
CHAIN = Chain(
    ("base", "tip"),
    np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0]]),
    np.array([[0.0, 0.0, 0.0], [0.0, 0.0, -0.2]]),
    ("hand",),
    np.array([[0.0, 0.05, -0.4]]),
)
SERVOS = ServoMap(
    ("base", "tip"),
    offset=np.zeros(2),
    gear=np.ones(2),
    unit=("counts",) * 2,
    counts_per_turn=np.full(2, 4096.0),
    sign=np.ones(2),
)


def mechanics(world="clean"):
    return Mechanics(
        CHAIN,
        servos=SERVOS,
        lower=np.full(2, -800.0),
        upper=np.full(2, 900.0),
        imperfections=IMPERFECTIONS[world],
        largest_torque=0.4,
    )


def station(world="clean", seed=0, drop=(), extra=None):
    """Compose a station of bare servos, whose motion capture repeats the true angles."""
    builder = DiagramBuilder()
    servos = builder.AddSystem(EncoderModel(mechanics(world), [0.0, 0.0], seed=seed))
    measured = builder.AddSystem(_Angles())
    builder.Connect(servos.GetOutputPort("q_true"), measured.get_input_port())
    builder.ExportInput(servos.GetInputPort("encoders_commanded"), "encoders_commanded")
    if "encoders" not in drop:
        builder.ExportOutput(servos.GetOutputPort("encoders"), "encoders")
    builder.ExportOutput(measured.get_output_port(), "p_WH_measured")
    return builder.Build()


class _Angles(LeafSystem):
    def __init__(self):
        super().__init__()
        port = self.DeclareVectorInputPort("angles", 2)
        self.DeclareVectorOutputPort(
            "points",
            BasicVector(3),
            lambda context, vector: vector.SetFromVector([*port.Eval(context), 0.0]),
        )


def body(**kinds):
    return StationBody(station(**kinds), JOINTS, ["hand"], sensor="motion-capture")


def test_a_visit_ends_where_it_was_sent_and_at_rest():
    driven = body()
    observation = driven.move_and_measure([300.4, -200.0])
    assert observation.encoders.tolist() == [300.0, -200.0]
    expected = SERVOS.to_joint(np.array([300.0, -200.0]))
    assert observation.points["hand"][:2] == pytest.approx(expected)


def test_a_motion_takes_as_long_as_its_way():
    near, far = body(), body()
    near.move_and_measure([50.0, 0.0])
    far.move_and_measure([880.0, 0.0])
    assert far.context.get_time() > near.context.get_time() + 0.3


def test_commands_beyond_the_stops_end_at_the_stops():
    assert body().move_and_measure([5000.0, -5000.0]).encoders.tolist() == [900.0, -800.0]


def test_play_is_drawn_anew_at_every_visit_of_the_same_pose():
    loose = body(world="thesis")
    seen = [loose.move_and_measure([300.0, 200.0]) for _ in range(6)]
    assert {tuple(s.encoders) for s in seen} == {(300.0, 200.0)}
    assert len({tuple(s.points["hand"]) for s in seen}) == 6


def test_the_same_seed_has_the_same_history():
    path = [[300.0, 200.0], [-100.0, 0.0], [300.0, 200.0]]
    histories = []
    for _ in range(2):
        loose = body(world="thesis", seed=5)
        histories.append([loose.move_and_measure(pose).points["hand"] for pose in path])
    assert np.array_equal(*histories)
    other = body(world="thesis", seed=6).move_and_measure(path[0]).points["hand"]
    assert not np.array_equal(other, histories[0][0])


def test_a_port_that_is_missing_is_named_with_those_there_are():
    with pytest.raises(RobotError, match="no output port 'encoders'; it has p_WH_measured"):
        body(drop=("encoders",))
    with pytest.raises(RobotError, match="no output port 'pixels'"):
        StationBody(station(), JOINTS, ["hand"])
    with pytest.raises(RobotError, match="no input port 'encoders_commanded'; it has none"):
        StationBody(ConstantVectorSource([1.0]), JOINTS, ["hand"])
    with pytest.raises(RobotError, match="has 3 values, expected 6"):
        StationBody(station(), JOINTS, ["hand", "elbow"], sensor="motion-capture")
    with pytest.raises(RobotError, match="left_image"):
        StationBody(station(), JOINTS, ["hand"], sensor="motion-capture", keep_images=True)


class _Restless(LeafSystem):
    """Encoders that never stand still."""

    def __init__(self):
        super().__init__()
        self.DeclareVectorInputPort("encoders_commanded", 2)
        self.DeclareVectorOutputPort(
            "encoders",
            BasicVector(2),
            lambda context, vector: vector.SetFromVector([context.get_time(), 0.0]),
        )
        self.DeclareVectorOutputPort(
            "p_WH_measured",
            BasicVector(3),
            lambda context, vector: vector.SetFromVector([0.0] * 3),
        )


def test_joints_that_never_come_to_rest_are_an_error():
    soon = SettleTimeouts(timeout=0.5)
    restless = StationBody(_Restless(), JOINTS, ["hand"], sensor="motion-capture", patience=soon)
    with pytest.raises(RobotError, match=r"did not come to rest within 0\.5 s: base reads"):
        restless.move_and_measure([100.0, 0.0])


@pytest.mark.parametrize("command", [[0.0], [np.nan, 0.0]])
def test_a_command_that_is_none_is_refused(command):
    with pytest.raises(ValueError, match="2 finite readings"):
        body().move_and_measure(command)
    with pytest.raises(ValueError, match="cameras or motion-capture"):
        StationBody(PassThrough(2), JOINTS, ["hand"], sensor="ears")


def test_servos_that_cannot_be_are_refused():
    with pytest.raises(ValueError, match="start must be 2 readings"):
        EncoderModel(mechanics(), [0.0])
    with pytest.raises(ValueError, match="speed positive"):
        EncoderModel(mechanics(), [0.0, 0.0], speed=0.0)


class _LateReplies(LeafSystem):
    """Servos that are read every 0.05 s, but not for a while: what is shown of them is old then.

    Motion capture sees them as they are. They turn 400 counts a second to where they were sent.
    """

    def __init__(self, silent_from, silent_until, nudged_at):
        super().__init__()
        command = self.DeclareVectorInputPort("encoders_commanded", 2)
        self.DeclareDiscreteState(5)  # where they are; the last reading, and when it was made

        def update(context, values):
            x, time = np.array(context.get_discrete_state_vector().value()), context.get_time()
            pushed = 3.0 if time > nudged_at else 0.0
            x[:2] += np.clip(command.Eval(context) + pushed - x[:2], -4.0, 4.0)
            if round(time / 0.01) % 5 == 0 and not silent_from < time < silent_until:
                x[2:4], x[4] = x[:2], time
            values.set_value(x)

        self.DeclarePeriodicDiscreteUpdateEvent(0.01, 0.0, update)

        def show(name, size, choose):
            self.DeclareVectorOutputPort(
                name,
                BasicVector(size),
                lambda context, vector: vector.SetFromVector(
                    choose(context.get_discrete_state_vector().value())
                ),
            )

        show("encoders", 2, lambda x: x[2:4])
        show("read_at", 2, lambda x: [x[4], x[4]])
        show("p_WH_measured", 3, lambda x: [*x[:2], 0.0])


def late(silent_from=np.inf, silent_until=np.inf, nudged_at=np.inf):
    """Return a body whose servos are silent for a while, or pushed aside from some time on."""
    builder = DiagramBuilder()
    servos = builder.AddSystem(_LateReplies(silent_from, silent_until, nudged_at))
    for name in ("encoders", "p_WH_measured"):  # who composes a station need not think of times
        builder.ExportOutput(servos.GetOutputPort(name), name)
    builder.ExportInput(servos.GetInputPort("encoders_commanded"), "encoders_commanded")
    patience = SettleTimeouts(settle=0.4, dither=2e-4, astray=0.02, timeout=4.0)
    return StationBody(
        builder.Build(), JOINTS, ["hand"], sensor="motion-capture", patience=patience
    )


@pytest.mark.parametrize("silence", [(0.5, 1.2), (0.98, 1.6), (0.02, 0.9), (1.1, 1.7)])
def test_readings_that_are_not_renewed_are_no_rest(silence):
    seen = late(*silence).move_and_measure([400.0, 0.0])
    assert seen.encoders == pytest.approx([400.0, 0.0])
    assert seen.points["hand"][:2] == pytest.approx(seen.encoders)


def test_a_rest_is_as_long_as_its_readings_say():
    body = late()
    body.move_and_measure([400.0, 0.0])
    assert 1.4 <= body.context.get_time() < 1.7


def test_who_is_never_read_again_is_no_joint_at_rest_elsewhere():
    with pytest.raises(RobotError, match=r"did not come to rest within 4 s"):
        late(0.5, 100.0).move_and_measure([400.0, 0.0])


def test_joints_that_move_while_somebody_looks_are_looked_at_again():
    calm = late()
    calm.move_and_measure([400.0, 0.0])
    # It looks, and then waits for the next reading, 0.05 s after the one before.
    body = late(nudged_at=calm.context.get_time() - 0.03)
    seen = body.move_and_measure([400.0, 0.0])
    assert seen.points["hand"][:2] == pytest.approx(seen.encoders)
    assert body.context.get_time() > calm.context.get_time() + 0.3


def test_joints_that_never_stay_where_they_were_looked_at_end_in_time(monkeypatch):
    body = late()
    look = body._look
    monkeypatch.setattr(body, "_look", lambda: replace(one := look(), encoders=one.encoders + 9.0))
    with pytest.raises(RobotError, match=r"did not stay at rest within 4 s.*does one swing or sag"):
        body.move_and_measure([400.0, 0.0])
    assert body.context.get_time() < 12.0
