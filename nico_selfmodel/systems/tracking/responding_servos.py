"""Servos as they were learned to respond: from commands to what encoders will read."""

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydrake.systems.framework import BasicVector, Context, DiscreteValues, LeafSystem

from nico_selfmodel.arrays import frozen_array
from nico_selfmodel.model.arm.servo_map import ServoMap
from nico_selfmodel.model.response.servo_response import ServoResponses
from nico_selfmodel.model.response.step_response import LOOP


class RespondingServos(LeafSystem):
    """Joints that follow commands after their delay, at their speed, acceleration and rate.

    | port | | carries |
    |---|---|---|
    | `encoders_commanded` | in | where joints shall go [encoder units]; nan stays |
    | `encoders` | out | what their encoders read [encoder units] |

    It stands for the servos of a simulated robot, and before a real one it says where the joints
    should be by now. Steps are followed as `ServoResponse.after` says, to what goes within a
    `period`; commands may change on the way.
    """

    def __init__(
        self,
        responses: ServoResponses,
        servos: ServoMap,
        start: ArrayLike,
        *,
        period: float = 0.002,
    ) -> None:
        """Take what `calibrate servos` learned.

        Args:
            responses: Of all joints of `servos`.
            servos: Units of the encoders.
            start: What they read in the beginning [encoder units]. Shape (n,).
            period: Time from one update to the next [s].

        Raises:
            ValueError: If the response of a joint is not known, or the period is not positive.
        """
        super().__init__()
        if not period > 0.0:
            raise ValueError(f"the period must be positive, got {period}")
        known = [responses.of(joint) for joint in servos.joints]
        self._n, self._units, self._dt = len(known), servos.radians_per_unit, period
        self._loop = np.array([one.kind == LOOP for one in known])
        self._v, self._a, self._rate = (
            np.array([getattr(one, name) or np.inf for one in known])
            for name in ("speed", "acceleration", "rate")
        )
        delays = np.array([max(one.delay, 0.0) for one in known]) / period
        self._late = np.rint(delays).astype(int)
        begin = self._units * frozen_array(start, (self._n,), "start")
        told = np.tile(begin, (int(self._late.max()) + 1, 1))
        self._rows = len(told)
        state = self.DeclareDiscreteState(
            np.concatenate([told.ravel(), begin, np.zeros(self._n), begin])
        )
        self._commanded = self.DeclareVectorInputPort("encoders_commanded", self._n)
        self.DeclarePeriodicDiscreteUpdateEvent(period, 0.0, self._update)
        needs = {self.discrete_state_ticket(state)}
        self.DeclareVectorOutputPort("encoders", BasicVector(self._n), self._read, needs)

    def _state(self, context: Context) -> tuple[NDArray, NDArray, NDArray, NDArray]:
        """Return the latest commands, where profiles are, how fast, and where joints are.

        The first have shape (m, n), the newest first, the others (n,) [rad, rad/s].
        """
        state = np.array(context.get_discrete_state_vector().value())
        told, rest = np.split(state, [self._rows * self._n])
        profile, speed, place = rest.reshape(3, self._n)
        return told.reshape(self._rows, self._n), profile, speed, place

    def _update(self, context: Context, update: DiscreteValues) -> None:
        told, profile, speed, place = self._state(context)
        new = self._units * np.asarray(self._commanded.Eval(context), dtype=float)
        told = np.vstack([np.where(np.isnan(new), told[0], new), told[:-1]])
        goal = told[self._late, np.arange(self._n)]
        speed, profile = self._profile(goal, profile, speed)
        aim = np.where(self._loop, goal, profile)
        # x' = rate (aim - x) over a period; a profile's speed is limited already.
        step = (aim - place) * -np.expm1(-self._rate * self._dt)
        most = np.where(self._loop, self._v, np.inf) * self._dt
        place = place + np.clip(step, -most, most)
        update.set_value(np.concatenate([told.ravel(), profile, speed, place]))

    def _profile(self, goal: NDArray, at: NDArray, speed: NDArray) -> tuple[NDArray, NDArray]:
        """Move trapezoids on by a period; return their speeds and places.

        The largest speed from which steps of a dt still come to rest within the distance d is
        ((a dt)^2 / 4 + 2 a |d|)^1/2 - a dt / 2.
        """
        d, dt = goal - at, self._dt
        a = np.where(np.isfinite(self._a), self._a, 0.0)
        stopping = np.sqrt(0.25 * (a * dt) ** 2 + 2.0 * a * np.abs(d)) - 0.5 * a * dt
        limit = np.minimum(self._v, np.where(np.isfinite(self._a), stopping, np.inf))
        wanted = np.sign(d) * np.minimum(limit, np.abs(d) / dt)
        speed = speed + np.clip(wanted - speed, -self._a * dt, self._a * dt)
        return speed, at + speed * dt

    def _read(self, context: Context, vector: BasicVector) -> None:
        vector.SetFromVector(self._state(context)[3] / self._units)
