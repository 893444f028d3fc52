"""Diagrams at both ends of a motion capture stream."""

import numpy as np
from pydrake.systems.framework import BasicVector, Context, DiscreteValues, EventStatus, LeafSystem

from nico_selfmodel.systems.hardware.motion_capture_stream import (
    MarkerFrame,
    MotionCaptureClient,
    MotionCaptureServer,
)


class MotionCaptureSender(LeafSystem):
    """Sends what motion capture measures to a server's clients.

    | port | | carries |
    |---|---|---|
    | `p_WH_measured` | in | x y z of each marker in turn, nan where lost [m] |

    The server belongs to whoever made it, and is closed there.
    """

    def __init__(self, server: MotionCaptureServer, rate: float = 100.0) -> None:
        """Take the server, and how many frames to send a second [1/s].

        Raises:
            ValueError: If the rate is not positive.
        """
        super().__init__()
        if not rate > 0.0:
            raise ValueError(f"rate must be positive, got {rate}")
        self._server, self._rate = server, rate
        self._positions = self.DeclareVectorInputPort("p_WH_measured", 3 * len(server.markers))
        self.DeclarePeriodicPublishEvent(1.0 / rate, 0.0, self._send)

    def _send(self, context: Context) -> EventStatus:
        rows = np.reshape(self._positions.Eval(context), (-1, 3))
        positions = {
            marker: p if np.isfinite(p).all() else None
            for marker, p in zip(self._server.markers, rows, strict=True)
        }
        time = context.get_time()
        self._server.send(MarkerFrame(round(time * self._rate), time, positions))
        return EventStatus.Succeeded()


class MotionCaptureReceiver(LeafSystem):
    """Receives what motion capture measured somewhere else.

    | port | | carries |
    |---|---|---|
    | `p_WH_measured` | out | x y z of each marker in turn, nan where lost [m] |
    | `frame_number` | out | number of the frame that they are from, as the sender counts |

    The newest frame is taken at every update. If the sender goes away, the next update raises
    `RobotError`. The client belongs to whoever made it, and is closed there.
    """

    def __init__(self, client: MotionCaptureClient, rate: float = 100.0) -> None:
        """Take the client, and how often to look for a new frame [1/s].

        Raises:
            ValueError: If the rate is not positive.
        """
        super().__init__()
        if not rate > 0.0:
            raise ValueError(f"rate must be positive, got {rate}")
        self._client = client
        self.markers = client.markers
        size = 3 * len(self.markers)
        state = self.DeclareDiscreteState(np.concatenate([np.full(size, np.nan), [-1.0]]))
        needs = {self.discrete_state_ticket(state)}
        self.DeclareInitializationDiscreteUpdateEvent(self._receive)
        self.DeclarePeriodicDiscreteUpdateEvent(1.0 / rate, 1.0 / rate, self._receive)
        self.DeclareVectorOutputPort("p_WH_measured", BasicVector(size), self._tell, needs)
        self.DeclareVectorOutputPort("frame_number", BasicVector(1), self._number, needs)

    def _receive(self, context: Context, update: DiscreteValues) -> EventStatus:
        frame = self._client.latest()
        nowhere = np.full(3, np.nan)
        rows = [nowhere if frame.positions[m] is None else frame.positions[m] for m in self.markers]
        update.set_value(np.concatenate([*rows, [float(frame.frame)]]))
        return EventStatus.Succeeded()

    def _tell(self, context: Context, vector: BasicVector) -> None:
        vector.SetFromVector(context.get_discrete_state_vector().value()[:-1])

    def _number(self, context: Context, vector: BasicVector) -> None:
        vector.SetFromVector(context.get_discrete_state_vector().value()[-1:])
