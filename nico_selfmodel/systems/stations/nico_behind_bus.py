"""A simulated Nico as what the motors of a simulated servo bus turn."""

import numpy as np
from numpy.typing import NDArray
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder

from nico_selfmodel.dataset.joint_info import JointInfo
from nico_selfmodel.servos import JointServo, ServoConfig
from nico_selfmodel.servos.arm.servo_config import HomePlan
from nico_selfmodel.systems.hardware.motion_capture_link import MotionCaptureSender
from nico_selfmodel.systems.hardware.motion_capture_stream import MotionCaptureServer
from nico_selfmodel.systems.stations.nico_station import NicoStation

_MAX_SPEED = np.radians(50.0)
"""Of the servos' encoders [rad/s]."""
FINEST = 200_000
"""Most counts a turn of the encoders."""
_LONGEST_STEP = 0.2
"""Time that the robot catches up with at once [s]: a busy machine must not fall further behind."""
_RATE = 25.0
"""Frames of motion capture a second [1/s]."""


class NicoBehindBus:
    """Turns a station's joints as simulated boards drive them: the `plant` of a `SimulatedBus`.

    One board drives each joint. Boards come up counting from 0, wherever the arm stands: as on
    the real robot the zero is due. The homes in `configuration` are where the arm stands then.
    """

    def __init__(self, station: NicoStation, server: MotionCaptureServer | None = None) -> None:
        """Take a station.

        Args:
            station: The robot; nobody else may advance it.
            server: Sends what the station's motion capture measures; closed by who made it.

        Raises:
            ValueError: If the station's encoders are finer than boards can keep up with.
        """
        if station.world.counts_per_turn > FINEST:
            raise ValueError(
                f"encoders of {station.world.counts_per_turn} counts a turn lag behind a board by "
                f"more than its error limit: give the world at most {FINEST}"
            )
        self.station = station
        builder = DiagramBuilder()
        builder.AddSystem(station)
        if server is not None:
            sender = builder.AddSystem(MotionCaptureSender(server, _RATE))
            builder.Connect(station.GetOutputPort("p_WH_measured"), sender.get_input_port())
        self._simulator = Simulator(builder.Build())
        self._context = station.GetMyMutableContextFromRoot(self._simulator.get_mutable_context())
        self._command = station.GetInputPort("encoders_commanded")
        self._start = self._readings()
        self._command.FixValue(self._context, self._start)
        self._time: float | None = None

    def __call__(self, time: float, commanded: NDArray) -> NDArray:
        """Let time pass while the boards drive their motors.

        Args:
            time: Of the bus [s].
            commanded: Where each board wants its shaft, counted from where it came up [counts]; nan
                where its servo is off. Shape (n,).

        Returns:
            Where the shafts are, counted likewise. Shape (n,).
        """
        passed = 0.0 if self._time is None else min(time - self._time, _LONGEST_STEP)
        self._time = time
        self._command.FixValue(self._context, self._start + commanded)
        self._simulator.AdvanceTo(self._context.get_time() + max(0.0, passed))
        return self._readings() - self._start

    def _readings(self) -> NDArray:
        return np.array(self.station.GetOutputPort("encoders").Eval(self._context))

    @property
    def configuration(self) -> ServoConfig:
        """The servos of this robot."""
        joints = zip(self.station.joints, self._start, strict=True)
        return ServoConfig(
            "simulated nico",
            tuple(_servo(joint, k, float(at)) for k, (joint, at) in enumerate(joints, start=1)),
            baud=115200,
        )


def _servo(joint: JointInfo, address: int, at: float) -> JointServo:
    unit = joint.radians_per_unit
    assert joint.lower is not None
    assert joint.upper is not None
    assert joint.counts_per_turn is not None
    return JointServo(
        joint.name,
        address,
        joint.counts_per_turn,
        lower=unit * joint.lower,
        upper=unit * joint.upper,
        max_velocity=_MAX_SPEED,
        max_acceleration=4.0 * _MAX_SPEED,
        home=HomePlan("here", unit * at),
    )
