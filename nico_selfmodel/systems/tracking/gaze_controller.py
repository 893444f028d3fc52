"""A head that keeps looking at a point, or at the body's own hand."""

import numpy as np
from numpy.typing import NDArray
from pydrake.systems.framework import BasicVector, Context, DiscreteValues, LeafSystem

from nico_selfmodel.errors import ModelError
from nico_selfmodel.model.tree.body_model import BodyModel
from nico_selfmodel.plant.looking.again import SeenOff
from nico_selfmodel.plant.looking.gaze import WITHIN_PX, GazeSolver


class GazeController(LeafSystem):
    """Says where the joints of the head shall go so that a point is in the images' middle.

    | port | | carries |
    |---|---|---|
    | `encoders` | in | readings of all joints of the body, nan of one not read [encoder units] |
    | `p_WT` | in | x y z of the point to look at, nan where nobody knows [m]; no port of a marker |
    | `pixels` | in | where its cameras see it, u v of each, nan where not [px]; may stay open |
    | `encoders_commanded` | out | where the head shall go, nan for the rest [encoder units] |
    | `looking` | out | 1 where the point is known and in reach; else 0, and the head's are nan |

    It looks anew every `period`, and stands still in between. Told what its cameras see, it looks
    at where the point is seen, in the mean over looks, and stands still while that is in the
    images' middle.
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
        self._names = [model.tree.sensors[i].name for i in self._solver.cameras]
        self._encoders = self.DeclareVectorInputPort("encoders", n)
        self._pixels = self.DeclareVectorInputPort("pixels", 2 * len(self._names))
        if marker is None:
            self._point = self.DeclareVectorInputPort("p_WT", 3)
        else:
            model.tree.marker_index(marker)
        nothing = np.concatenate([np.full(n, np.nan), np.zeros(5)])
        state = self.DeclareDiscreteState(nothing)
        self.DeclarePeriodicDiscreteUpdateEvent(period, 0.0, self._look)
        needs = {self.discrete_state_ticket(state)}
        self.DeclareVectorOutputPort("encoders_commanded", BasicVector(n), self._command, needs)
        self.DeclareVectorOutputPort("looking", BasicVector(1), self._tell, needs)

    def _look(self, context: Context, update: DiscreteValues) -> None:
        now = np.asarray(self._encoders.Eval(context), dtype=float)
        command, looking, off = self._state(context)
        nowhere = np.full(len(now), np.nan)
        if not self._known(context, now):
            update.set_value(_as_state(nowhere, 0.0, off))
            return
        try:
            expected = self._expected(context, now)
            if seen := self._seen(context):
                off = self._solver.again(now, expected, seen, off)
                far, misaligned = self._solver.off_middle(seen)
                if looking and far - misaligned <= WITHIN_PX:
                    update.set_value(_as_state(command, 1.0, off))
                    return
            found = self._solver.at_point(now, expected + off.offset)
        except ModelError:
            update.set_value(_as_state(nowhere, 0.0, SeenOff()))
            return
        command = nowhere
        command[self._solver.head] = found.readings[self._solver.head]
        update.set_value(_as_state(command, 1.0, off))

    def _known(self, context: Context, now: NDArray) -> bool:
        """Whether all joints are read, and the point is known."""
        read = np.isfinite(now[self._solver.read]).all()
        return bool(read and (self._marker or np.isfinite(self._point.Eval(context)).all()))

    def _expected(self, context: Context, now: NDArray) -> NDArray:
        if self._marker is not None:
            return self._solver.place_of(now, self._marker)
        return np.asarray(self._point.Eval(context), dtype=float)

    def _seen(self, context: Context) -> dict[str, NDArray]:
        if not self._pixels.HasValue(context):
            return {}
        pixels = np.asarray(self._pixels.Eval(context), dtype=float).reshape(-1, 2)
        return dict(zip(self._names, pixels, strict=True))

    def _state(self, context: Context) -> tuple[NDArray, float, SeenOff]:
        """Return the command, whether it looks, and how far off the point is."""
        state = np.asarray(context.get_discrete_state_vector().value())
        looking, looks = state[-5:-3]
        return state[:-5].copy(), looking, SeenOff(state[-3:].copy(), int(looks))

    def _command(self, context: Context, vector: BasicVector) -> None:
        vector.SetFromVector(self._state(context)[0])

    def _tell(self, context: Context, vector: BasicVector) -> None:
        vector.SetFromVector([self._state(context)[1]])


def _as_state(command: NDArray, looking: float, off: SeenOff) -> NDArray:
    return np.concatenate([command, [looking, off.looks], off.offset])
