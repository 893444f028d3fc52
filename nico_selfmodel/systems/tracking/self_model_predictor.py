"""What a self-model expects at encoder readings: where the hand is and where cameras see it."""

import numpy as np
from pydrake.systems.framework import BasicVector, Context, LeafSystem

from nico_selfmodel.errors import ModelError
from nico_selfmodel.model.cameras.stereo_rig import SIDES
from nico_selfmodel.model.self_model import SelfModel


class SelfModelPredictor(LeafSystem):
    """Forward kinematics with uncertainty, and its projection into both cameras (thesis eq. 7.4).

    | port | | carries |
    |---|---|---|
    | `encoders` | in | encoder readings, in the encoders' units |
    | `p_WH` | out | predicted point on the hand in the self-model's frame [m] |
    | `covariance` | out | of `p_WH`, 3 x 3 row by row, nan where not known [m^2] |
    | `pixels` | out | left u, v and right u, v of it, nan where a camera cannot see it [px] |

    `pixels` is there only if the self-model has both cameras. What else blocks the view, as the
    body itself, is not in the prediction.
    """

    def __init__(self, model: SelfModel, marker: str | None = None) -> None:
        """Take a self-model.

        Args:
            model: With an arm.
            marker: Which tracked point; the first one if omitted.

        Raises:
            ModelError: If the model has no arm.
            ValueError: If there is no such marker.
        """
        super().__init__()
        if not model.has_arm:
            raise ModelError(f"self-model {model.name!r} has no arm to predict: learn it first")
        self.model = model
        self.marker = model.markers[0] if marker is None else marker
        self._index = np.array([model.chain.marker_index(self.marker)])
        self._encoders = self.DeclareVectorInputPort("encoders", len(model.joints))
        needs = {self._encoders.ticket()}
        self.DeclareVectorOutputPort("p_WH", BasicVector(3), self._point, needs)
        self.DeclareVectorOutputPort("covariance", BasicVector(9), self._covariance, needs)
        if set(model.cameras) == set(SIDES):
            self.DeclareVectorOutputPort("pixels", BasicVector(4), self._pixels, needs)

    def _point(self, context: Context, vector: BasicVector) -> None:
        prediction = self.model.predict(self._encoders.Eval(context), self._index)
        vector.SetFromVector(prediction.p_WH[0])

    def _covariance(self, context: Context, vector: BasicVector) -> None:
        covariance = self.model.predict(self._encoders.Eval(context), self._index).covariance
        vector.SetFromVector(np.full(9, np.nan) if covariance is None else covariance[0].ravel())

    def _pixels(self, context: Context, vector: BasicVector) -> None:
        p_WH = self.model.predict(self._encoders.Eval(context), self._index).p_WH
        vector.SetFromVector(self.model.rig.project(p_WH)[0])
