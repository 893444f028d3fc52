"""A head that turns to a point, looks, and turns again until it has it in the middle."""

import numpy as np
import pytest
from pydrake.systems.analysis import Simulator

from nico_selfmodel.errors import ModelError, RobotError
from nico_selfmodel.plant.looking.gaze import WITHIN_PX, GazeSolver
from nico_selfmodel.recording.session import Body
from nico_selfmodel.sessions.gazing import look_at
from nico_selfmodel.sessions.whole_body import room_about_nico, whole_nico
from nico_selfmodel.systems.measurements import Measurement
from nico_selfmodel.systems.simulated.imperfections import IMPERFECTIONS
from nico_selfmodel.systems.simulated.instance import RobotInstance
from nico_selfmodel.systems.simulated.robot import SimulatedRobot
from nico_selfmodel.systems.simulated.sensors import StereoPixels
from nico_selfmodel.systems.tracking.gaze_controller import GazeController

from ..true_nico import known_exactly

HAND = "right_hand_fiducial"


def robot_and_model(seed, wrong=True, session=0):
    """A whole Nico, and a body model that knows it exactly, but for zeros of the arms."""
    nico, _ = whole_nico(IMPERFECTIONS["thesis"], seed)
    mechanics = nico.mechanics
    arms = np.arange(len(mechanics.servos.joints)) >= 6
    model = known_exactly(mechanics, mechanics.tree, 0.05 * arms if wrong else 0.0)
    instance = RobotInstance(mechanics, X_TB=nico.X_TB)
    return SimulatedRobot(instance, StereoPixels(0.3), (seed, session)), model, nico


def before_the_face(nico, rng):
    """Readings of a raised right hand."""
    q = np.zeros(18)
    names = list(nico.body.joints)
    q[names.index("right_shoulder_pitch")] = -0.8 + rng.uniform(-0.15, 0.15)
    q[names.index("right_elbow")] = -0.9 + rng.uniform(-0.15, 0.15)
    return nico.mechanics.servos.to_encoder(q)


@pytest.mark.slow
@pytest.mark.parametrize("seed", [0, 1, 2, 3])
def test_a_hand_that_is_not_where_it_is_expected_comes_to_the_middle(seed):
    robot, model, nico = robot_and_model(seed)
    solver, rng = GazeSolver(model), np.random.default_rng(seed)
    hands = [before_the_face(nico, rng) for _ in range(8)]
    once = [look_at(robot, solver, now, HAND, looks=1) for now in hands]
    more = [look_at(robot, solver, now, HAND) for now in hands]
    assert np.mean([one.in_middle for one in once]) <= 0.5
    assert np.mean([one.in_middle for one in more]) >= 0.95
    assert all(one.looks == 1 for one in once)
    assert max(one.looks for one in more) > 1
    assert all(
        one.in_middle == (one.off_px - one.misaligned_px <= WITHIN_PX) for one in (*once, *more)
    )


def test_a_marker_in_the_room_is_looked_at_from_where_it_was_said_to_be():
    robot, model, nico = robot_and_model(0, wrong=False)
    place = room_about_nico()["card0_0"]
    told = place + np.array([0.0, 0.05, 0.03])
    found = look_at(robot, GazeSolver(model), nico.mechanics.servos.to_encoder(np.zeros(18)),
                    "card0_0", told)  # fmt: skip
    assert found.in_middle
    assert found.looks > 1


def test_a_marker_that_a_look_does_not_see_ends_it():
    robot, model, nico = robot_and_model(0, wrong=False)
    place = np.array([0.1, 0.8, 0.5])
    assert np.linalg.norm(place - room_about_nico()["card0_0"]) > 0.8
    start = nico.mechanics.servos.to_encoder(np.zeros(18))
    found = look_at(robot, GazeSolver(model), start, "card0_0", place)
    assert found.looks == 1
    assert not found.in_middle
    assert np.isnan(found.off_px)


class _BlindRobot:
    """Measures nothing in pictures."""

    joints, markers = (), ()

    def move_and_measure(self, command):
        return Measurement(np.asarray(command), {})


def test_what_cannot_be_looked_at_says_so():
    robot, model, nico = robot_and_model(0)
    solver, start = GazeSolver(model), nico.mechanics.servos.to_encoder(np.zeros(18))
    with pytest.raises(ModelError, match="out of reach"):
        look_at(robot, solver, start, HAND, [-1.0, 0.0, 0.4])
    with pytest.raises(ValueError, match="looks must be at least 1, got 0"):
        look_at(robot, solver, start, HAND, looks=0)
    body: Body = _BlindRobot()
    with pytest.raises(RobotError, match="nothing looks for 'right_hand_fiducial'"):
        look_at(body, solver, start, HAND, [0.6, 0.0, 0.4])


def test_the_system_that_is_told_what_cameras_see_turns_to_it_and_then_stands_still():
    robot, model, nico = robot_and_model(1)
    system = GazeController(model, marker=HAND)
    simulator = Simulator(system)
    context = simulator.get_mutable_context()
    encoders, pixels = system.GetInputPort("encoders"), system.GetInputPort("pixels")
    command = system.GetOutputPort("encoders_commanded")
    now, commands, off = before_the_face(nico, np.random.default_rng(1)), [], []
    names, solver = list(model.tree.lenses), GazeSolver(model)
    encoders.FixValue(context, now)
    pixels.FixValue(context, np.full(4, np.nan))
    for k in range(12):
        simulator.AdvanceTo(0.1 * k + 0.05)
        commands.append(command.Eval(context))
        seen = robot.move_and_measure(np.where(np.isfinite(commands[-1]), commands[-1], now))
        encoders.FixValue(context, seen.encoders)
        pixels.FixValue(context, seen.pixels[HAND])
        told = dict(zip(names, seen.pixels[HAND].reshape(2, 2), strict=True))
        off.append(float(np.subtract(*solver.off_middle(told))))
    assert off[0] > WITHIN_PX
    middle = [k for k in range(3, 11) if off[k] <= WITHIN_PX]
    assert len(middle) >= 4
    assert all(np.array_equal(commands[k + 1], commands[k], equal_nan=True) for k in middle)


@pytest.mark.parametrize("lost", ["point", "reading"])
def test_what_is_lost_for_one_look_is_looked_at_again_with_what_earlier_looks_told(lost):
    _, model, nico = robot_and_model(1, wrong=False)
    system, solver = GazeController(model), GazeSolver(model)
    simulator = Simulator(system)
    context = simulator.get_mutable_context()
    now, point = nico.mechanics.servos.to_encoder(np.zeros(18)), np.array([0.6, 0.1, 0.4])
    said, offsets = [], []
    for k in range(7):
        readings, told = now.copy(), point + (k > 4) * np.array([0.0, 0.1, 0.0])
        # The point is seen beside where it is told to be.
        cameras = solver._cameras(now).values()
        pixels = np.concatenate([camera.project(told + 0.01) for camera in cameras])
        if k == 3 and lost == "point":
            told = np.full(3, np.nan)
        elif k == 3:
            readings[-1] = np.nan
        for port, value in (("encoders", readings), ("p_WT", told), ("pixels", pixels)):
            system.GetInputPort(port).FixValue(context, value)
        simulator.AdvanceTo(0.1 * k + 0.05)
        command = system.GetOutputPort("encoders_commanded").Eval(context)
        now = np.where(np.isfinite(command), command, now)
        said.append(float(system.GetOutputPort("looking").Eval(context)[0]))
        offsets.append(context.get_discrete_state_vector().value()[-3:].copy())
    assert said == [1.0, 1.0, 1.0, 0.0, 1.0, 1.0, 1.0]
    assert np.linalg.norm(offsets[2] - 0.01) < 2e-3
    np.testing.assert_array_equal(offsets[3], offsets[2])
    assert np.linalg.norm(offsets[-1] - 0.01) < 2e-3
