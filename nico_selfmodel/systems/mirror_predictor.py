"""Where a body expects to see itself: encoder readings in, pixels out, direct and in mirrors."""

import numpy as np
from numpy.typing import NDArray
from pydrake.systems.framework import BasicVector, Context, LeafSystem

from nico_selfmodel.model import SelfModel
from nico_selfmodel.model.mirror_rig import MirrorRig


class MirrorPredictor(LeafSystem):
    """Predicts the pixels of a tracked point in both eyes, directly and in every known mirror.

    | port | | carries |
    |---|---|---|
    | `encoders` | in | encoder readings, in the encoders' units |
    | `p_WH` | out | predicted point on the hand in the self-model's frame [m] |
    | `pixels` | out | left u, v and right u, v of it [px] |
    | `reflected.<mirror>` | out | the same of its reflection, one port a mirror [px] |

    A pixel is nan where an eye cannot see the point, or it is not in front of the glass. What else
    blocks the view, and where the glass ends, is not in the prediction.
    """

    def __init__(self, model: SelfModel, marker: str | None = None) -> None:
        """Take what the body knows.

        Args:
            model: With arm, eyes and any number of mirrors.
            marker: Which tracked point; the first one if omitted.

        Raises:
            ModelError: If the model has no arm or no eyes.
            ValueError: If there is no such marker.
        """
        super().__init__()
        self.model, self._rig = model, model.rig
        self._marker = 0 if marker is None else model.chain.marker_index(marker)
        self._encoders = self.DeclareVectorInputPort("encoders", len(model.joints))
        self._needs = {self._encoders.ticket()}
        self.DeclareVectorOutputPort("p_WH", BasicVector(3), self._point, self._needs)
        self.DeclareVectorOutputPort("pixels", BasicVector(4), self._pixels, self._needs)
        for name in model.mirrors:
            self._declare_reflected(name, model.mirror_rig(name))

    def _declare_reflected(self, name: str, rig: MirrorRig) -> None:
        def reflected(context: Context, vector: BasicVector) -> None:
            vector.SetFromVector(rig.project(self._hand(context)))

        self.DeclareVectorOutputPort(f"reflected.{name}", BasicVector(4), reflected, self._needs)

    def _point(self, context: Context, vector: BasicVector) -> None:
        vector.SetFromVector(self._hand(context))

    def _pixels(self, context: Context, vector: BasicVector) -> None:
        vector.SetFromVector(self._rig.project(self._hand(context)))

    def _hand(self, context: Context) -> NDArray:
        q = self.model.servos.to_joint(np.asarray(self._encoders.Eval(context)))
        return self.model.chain.forward(q, self._marker)
