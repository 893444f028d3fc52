"""Drive servos from a diagram of one's own: an elbow that follows a sine, through real bytes.

The boards are simulated behind a pseudo-terminal. With real ones, leave the bus out and give the
name of the serial port, and home the arm first (`nico-selfmodel servo home`).
"""

import numpy as np
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import BasicVector, Context, DiagramBuilder, LeafSystem
from pydrake.systems.primitives import LogVectorOutput

from nico_selfmodel.servos import JointServo, ServoConfig, SimulatedBus
from nico_selfmodel.systems import AnglesToEncoders, ServoDriver

ELBOW, WRIST = 0, 1


class Swing(LeafSystem):
    """Wishes of where the joints should be: the elbow swings, the wrist is not commanded."""

    def __init__(self) -> None:
        """Have one port."""
        super().__init__()
        self.DeclareVectorOutputPort("q_commanded", BasicVector(2), self._wish)

    def _wish(self, context: Context, wish: BasicVector) -> None:
        wish[ELBOW] = 0.3 * np.sin(2.0 * context.get_time())
        wish[WRIST] = np.nan


config = ServoConfig(
    "two joints",
    tuple(
        JointServo(name, address, 200_000, -1.5, 1.5, max_velocity=1.0, max_acceleration=4.0)
        for address, name in enumerate(("elbow", "wrist"), start=1)
    ),
    baud=115200,
)
with SimulatedBus(2) as bus, ServoDriver(bus.name, config, trust_zero=True) as servos:
    builder = DiagramBuilder()
    swing = builder.AddNamedSystem("swing", Swing())
    builder.AddNamedSystem("servos", servos)
    counts = builder.AddNamedSystem("counts", AnglesToEncoders(servos.servos))
    builder.Connect(swing.get_output_port(), counts.get_input_port())
    builder.Connect(counts.get_output_port(), servos.GetInputPort("encoders_commanded"))
    log = LogVectorOutput(servos.GetOutputPort("q_measured"), builder, 0.05)
    diagram = builder.Build()

    servos.enable()  # only now the motors hold, and only a command moves them
    simulator = Simulator(diagram)
    simulator.set_target_realtime_rate(1.0)  # an arm lives in real time
    simulator.AdvanceTo(4.0)

    context = servos.GetMyContextFromRoot(simulator.get_context())
    q = log.FindLog(simulator.get_context()).data()
    for name, words in zip(
        servos.joints, servos.GetOutputPort("status").Eval(context), strict=True
    ):
        print(f"{name}: {words}")
low, high = np.nanmin(q, axis=1), np.nanmax(q, axis=1)
print(f"the elbow swung from {low[ELBOW]:.2f} to {high[ELBOW]:.2f} rad")
print(f"the wrist moved by {high[WRIST] - low[WRIST]:.2f} rad")
