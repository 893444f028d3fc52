"""A simulated Nico as what the motors of a simulated servo bus turn."""

import numpy as np
from numpy.typing import NDArray
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder

from nico_selfmodel.dataset.joint_info import JointInfo
from nico_selfmodel.servos import JointServo, ServoConfig
from nico_selfmodel.servos.arm.servo_config import HomePlan
from nico_selfmodel.servos.makes import PIC_SERVO, Make
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
    """Turns a station's joints as simulated motors drive them: the `plant` of a `SimulatedBus`.

    One motor drives each joint. PIC-SERVO boards come up counting from 0, wherever the arm stands:
    as on the real robot the zero is due, and the homes in `configuration` are where the arm stands
    then. Other servos know where they are.
    """

    def __init__(
        self,
        station: NicoStation,
        server: MotionCaptureServer | None = None,
        make: Make = PIC_SERVO,
    ) -> None:
        """Take a station.

        Args:
            station: The robot; nobody else may advance it.
            server: Sends what the station's motion capture measures; closed by who made it.

        Raises:
            ValueError: If the station's encoders are finer than boards can keep up with, or other
                than those of the make.
        """
        counts = make.counts_per_turn
        if counts is not None and station.world.counts_per_turn != counts:
            raise ValueError(
                f"{make.title} have {counts:g} counts a turn, the station's encoders "
                f"{station.world.counts_per_turn}: give the world as many"
            )
        if station.world.counts_per_turn > FINEST:
            raise ValueError(
                f"encoders of {station.world.counts_per_turn} counts a turn lag behind a board by "
                f"more than its error limit: give the world at most {FINEST}"
            )
        self.station, self.make = station, make
        builder = DiagramBuilder()
        builder.AddSystem(station)
        if server is not None:
            sender = builder.AddSystem(MotionCaptureSender(server, _RATE))
            builder.Connect(station.GetOutputPort("p_WH_measured"), sender.get_input_port())
        self._simulator = Simulator(builder.Build())
        self._context = station.GetMyMutableContextFromRoot(self._simulator.get_mutable_context())
        self._command = station.GetInputPort("encoders_commanded")
        self._start = self._readings()
        self._from_shaft = self._start
        """Readings where the shafts are at 0."""
        if make.keeps_zero:
            ends = np.array([(joint.lower, joint.upper) for joint in station.joints], dtype=float)
            self._from_shaft = np.round(ends.mean(axis=1)) - make.zero_counts
        self._command.FixValue(self._context, self._start)
        self._time: float | None = None

    def __call__(self, time: float, commanded: NDArray) -> NDArray:
        """Let time pass while the boards drive their motors.

        Args:
            time: Of the bus [s].
            commanded: Where each motor wants its shaft [counts]; nan where its servo is off. Shape
                (n,).

        Returns:
            Where the shafts are, counted likewise. Shape (n,).
        """
        passed = 0.0 if self._time is None else min(time - self._time, _LONGEST_STEP)
        self._time = time
        self._command.FixValue(self._context, self._from_shaft + commanded)
        self._simulator.AdvanceTo(self._context.get_time() + max(0.0, passed))
        return self._readings() - self._from_shaft

    def _readings(self) -> NDArray:
        return np.array(self.station.GetOutputPort("encoders").Eval(self._context))

    @property
    def configuration(self) -> ServoConfig:
        """The servos of this robot."""
        joints = zip(self.station.joints, self._start, self._from_shaft, strict=True)
        return ServoConfig(
            "simulated nico",
            tuple(
                _servo(joint, k, float(at), self.make, round(-zero))
                for k, (joint, at, zero) in enumerate(joints, start=1)
            ),
            baud=1_000_000 if self.make.keeps_zero else 115200,
        )


def _servo(joint: JointInfo, address: int, at: float, make: Make, zero: int) -> JointServo:
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
        make=make,
        zero_counts=zero if make.keeps_zero else None,
    )
