"""A head that keeps looking at a point, or at the body's own hand."""

import numpy as np
from numpy.typing import NDArray
from pydrake.systems.framework import BasicVector, Context, DiscreteValues, LeafSystem

from nico_selfmodel.errors import ModelError
from nico_selfmodel.model.tree.body_model import BodyModel
from nico_selfmodel.plant.gaze import GazeSolver


class GazeController(LeafSystem):
    """Says where the joints of the head shall go so that a point is in the images' middle.

    | port | | carries |
    |---|---|---|
    | `encoders` | in | readings of all joints of the body [encoder units] |
    | `p_WT` | in | x y z of the point to look at [m]; not there where a marker is looked at |
    | `encoders_commanded` | out | where the head shall go, nan for the rest [encoder units] |
    | `looking` | out | 1 where the point is in reach, else 0: the head's are nan too then |

    It looks anew every `period`, and stands still in between.
    """

    def __init__(self, model: BodyModel, *, marker: str | None = None, period: float = 0.1) -> None:
        """Take a learned body.

        Args:
            model: It; all its joints have encoders.
            marker: What it looks at on itself; a point by the port `p_WT` if omitted.
            period: Time from one look to the next [s].

        Raises:
            ModelError: If no joint turns a camera.
            ValueError: If there is no such marker.
        """
        super().__init__()
        self._solver, self._marker, n = GazeSolver(model), marker, len(model.tree.joints)
        self._encoders = self.DeclareVectorInputPort("encoders", n)
        if marker is None:
            self._point = self.DeclareVectorInputPort("p_WT", 3)
        else:
            model.tree.marker_index(marker)
        state = self.DeclareDiscreteState(np.append(np.full(n, np.nan), 0.0))
        self.DeclarePeriodicDiscreteUpdateEvent(period, 0.0, self._look)
        needs = {self.discrete_state_ticket(state)}
        self.DeclareVectorOutputPort("encoders_commanded", BasicVector(n), self._command, needs)
        self.DeclareVectorOutputPort("looking", BasicVector(1), self._tell, needs)

    def _look(self, context: Context, update: DiscreteValues) -> None:
        now = np.asarray(self._encoders.Eval(context), dtype=float)
        out = np.full(len(now), np.nan)
        try:
            if self._marker is None:
                found = self._solver.at_point(now, self._point.Eval(context))
            else:
                found = self._solver.at_marker(now, self._marker)
        except ModelError:
            update.set_value(np.append(out, 0.0))
            return
        out[self._solver.head] = found.readings[self._solver.head]
        update.set_value(np.append(out, 1.0))

    def _state(self, context: Context) -> NDArray:
        return np.asarray(context.get_discrete_state_vector().value()).copy()

    def _command(self, context: Context, vector: BasicVector) -> None:
        vector.SetFromVector(self._state(context)[:-1])

    def _tell(self, context: Context, vector: BasicVector) -> None:
        vector.SetFromVector(self._state(context)[-1:])
