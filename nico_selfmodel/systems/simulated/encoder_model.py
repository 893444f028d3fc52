"""Servos that turn joints to where their encoders say, and what lies between encoder and link."""

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydrake.systems.framework import BasicVector, Context, DiscreteValues, LeafSystem

from nico_selfmodel.systems.closing import Closable
from nico_selfmodel.systems.simulated.joint_mechanics import JointMechanics

PERIOD = 0.01
"""Time between two steps of the servos [s]."""
_APPROACH = 0.4
"""Share of the way left that a servo covers in a step, near its goal."""


class EncoderModel(Closable, LeafSystem):
    """Servos with encoders on the motor's side; backlash, play, sag and wobble on the link's.

    | port | | carries |
    |---|---|---|
    | `encoders_commanded` | in | where to go [encoder units]; kept between the stops |
    | `encoders` | out | encoder readings, whole counts [encoder units] |
    | `q_true` | out | where the links really stand [rad] |

    A servo turns at `speed` and then creeps up to its goal. Play and wobble are drawn anew for
    every new command: the draw depends on the seed and on how many commands came before.
    """

    def __init__(
        self,
        mechanics: JointMechanics,
        start: ArrayLike,
        *,
        seed: int | tuple[int, ...] = 0,
        speed: float = 2.0,
    ) -> None:
        """Build the servos.

        Args:
            mechanics: The joints as they are built, with their play, sag and wobble.
            start: Readings to begin at [encoder units]. Shape (n,).
            seed: Of play and wobble.
            speed: Of the links [rad/s].

        Raises:
            ValueError: If the start is not n readings, or the speed is not positive.
        """
        super().__init__()
        n = len(mechanics.servos.joints)
        start = np.asarray(start, dtype=float)
        if start.shape != (n,) or not np.isfinite(start).all() or not speed > 0.0:
            raise ValueError(f"start must be {n} readings and speed positive, got {start}, {speed}")
        self.__mechanics, self._seed = mechanics, np.ravel(seed)
        scale = np.abs(mechanics.servos.gear / mechanics.servos.radians_per_unit)
        self._step = speed * PERIOD * scale
        self._n = n
        self._command = self.DeclareVectorInputPort("encoders_commanded", n)
        place = np.clip(np.round(start), mechanics.lower, mechanics.upper)
        # Readings, the last command, where it drags the joints, how many commands there have been.
        dragged = mechanics.dragged(place)
        state = self.DeclareDiscreteState(np.concatenate([place, place, dragged, [0.0]]))
        self.DeclarePeriodicDiscreteUpdateEvent(PERIOD, 0.0, self._turn)
        needs = {self.discrete_state_ticket(state)}
        self.DeclareVectorOutputPort("encoders", BasicVector(n), self._read, needs)
        self.DeclareVectorOutputPort("q_true", BasicVector(n), self._stand, needs)

    def _turn(self, context: Context, update: DiscreteValues) -> None:
        """Go on towards the command."""
        place, last, dragged, moves = self._state(context)
        wanted = np.asarray(self._command.Eval(context), dtype=float)
        # Before anybody commands, a port may carry nothing: the servos then stay.
        wanted = np.where(np.isfinite(wanted), wanted, last)
        goal = np.clip(np.round(wanted), self.__mechanics.lower, self.__mechanics.upper)
        moves += float(not np.array_equal(goal, last))
        step = np.clip(_APPROACH * (goal - place), -self._step, self._step)
        place = np.where(np.abs(goal - place) < 2.0, goal, np.round(place + step))
        dragged = self.__mechanics.dragged(place, dragged)
        update.set_value(np.concatenate([place, goal, dragged, [moves]]))

    def _state(self, context: Context) -> tuple[NDArray, NDArray, NDArray, float]:
        self.require_open()
        value = context.get_discrete_state_vector().value().copy()
        place, last, dragged = value[:-1].reshape(3, self._n)
        return place, last, dragged, float(value[-1])

    def _read(self, context: Context, vector: BasicVector) -> None:
        vector.SetFromVector(self._state(context)[0])

    def _stand(self, context: Context, vector: BasicVector) -> None:
        _, _, dragged, moves = self._state(context)
        rng = np.random.default_rng([*self._seed, 1, int(moves)])
        vector.SetFromVector(self.__mechanics.angles(dragged, rng))
