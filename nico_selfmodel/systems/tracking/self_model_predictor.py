"""What a self-model expects at encoder readings: where the hand is and where cameras see it."""

from typing import Any

import numpy as np
from numpy.typing import NDArray
from pydrake.autodiffutils import AutoDiffXd, ExtractValue
from pydrake.systems.framework import (
    BasicVector_,  # pyright: ignore[reportAttributeAccessIssue]
    LeafSystem_,  # pyright: ignore[reportAttributeAccessIssue]
)
from pydrake.systems.scalar_conversion import TemplateSystem

from nico_selfmodel.errors import ModelError, check_kind
from nico_selfmodel.geometry.transform import apply
from nico_selfmodel.model.cameras.rig_parameters import SIDES
from nico_selfmodel.model.cameras.stereo_rig import StereoRig
from nico_selfmodel.model.self_model import SelfModel
from nico_selfmodel.systems.scalars import of_scalars, quiet


@TemplateSystem.define("SelfModelPredictor_")
def SelfModelPredictor_(T: Any) -> Any:
    """Return `SelfModelPredictor` for floats, `AutoDiffXd` or `Expression`."""

    class SelfModelPredictor(LeafSystem_[T]):
        """Forward kinematics with uncertainty, and its projection into both cameras (eq. 7.4).

        | port | | carries |
        |---|---|---|
        | `encoders` | in | encoder readings, in the encoders' units |
        | `p_WH_predicted` | out | point on the hand in the self-model's frame [m] |
        | `covariance` | out | of that point, 3 x 3 row by row, nan where not known [m^2] |
        | `pixels_predicted` | out | left u, v and right u, v, nan where out of view [px] |

        `pixels_predicted` is there only if the self-model has both cameras. What else blocks the
        view, as the body itself, is not in the prediction; nor is the border of the view where it
        is an `Expression`. A diagram with it converts to AutoDiff and symbolic; expressions of an
        arm that bends are too large to be evaluated.
        """

        def _construct(
            self, model: SelfModel, marker: str | None = None, *, converter: Any = None
        ) -> None:
            """Take a self-model, and a tracked point of it, the first one if omitted.

            Raises:
                ModelError: If the model has no arm.
                TypeError: If it is no self-model.
                ValueError: If there is no such marker.
            """
            LeafSystem_[T].__init__(self, converter)
            check_kind(model, SelfModel, "give a self-model; a body is in a plant by BodyPlant")
            if not model.has_arm:
                raise ModelError(f"self-model {model.name!r} has no arm to predict: learn it first")
            self.model, self.marker = model, model.markers[0] if marker is None else marker
            self._index = np.array([model.chain.marker_index(self.marker)])
            self._encoders = self.DeclareVectorInputPort("encoders", len(model.joints))
            needs = {self._encoders.ticket()}
            ports = {"p_WH_predicted": (3, self._point), "covariance": (9, self._covariance)}
            if set(model.cameras) == set(SIDES):
                ports["pixels_predicted"] = (4, self._pixels)
            for name, (size, calc) in ports.items():
                self.DeclareVectorOutputPort(name, BasicVector_[T](size), calc, needs)

        def _construct_copy(self, other: Any, converter: Any = None) -> None:
            self._construct(other.model, other.marker, converter=converter)

        @quiet
        def _point(self, context: Any, vector: Any) -> None:
            vector.SetFromVector(_hand(self, context))

        @quiet
        def _covariance(self, context: Any, vector: Any) -> None:
            covariance = self.model.predict(self._encoders.Eval(context), self._index).covariance
            known = np.full(9, np.nan) if covariance is None else covariance[0].ravel()
            vector.SetFromVector(of_scalars(T, known))

        @quiet
        def _pixels(self, context: Any, vector: Any) -> None:
            vector.SetFromVector(of_scalars(T, _pixels_of(T, self.model.rig, _hand(self, context))))

    return SelfModelPredictor


SelfModelPredictor: Any = SelfModelPredictor_[None]
"""The system of floats, which diagrams are made of."""


def _hand(system: Any, context: Any) -> NDArray:
    q = system.model.servos.to_joint(system.get_input_port().Eval(context))
    return system.model.points(q, system._index)


def _pixels_of(T: Any, rig: StereoRig, p_WH: NDArray) -> NDArray:
    """Return pixels of a point in both cameras. Shape (4,)."""
    if T is float:
        return _in_view(rig, p_WH)
    pixels = []
    for camera in rig.cameras:
        pixels += list(camera.pixels_of_points(apply(camera.X_CW, p_WH)))
    if T is AutoDiffXd:
        seen = np.isfinite(_in_view(rig, ExtractValue(p_WH).ravel()))
        pixels = [u if there else np.nan for u, there in zip(pixels, seen, strict=True)]
    return np.array(pixels, dtype=object)


def _in_view(rig: StereoRig, p_WH: NDArray) -> NDArray:
    """Return pixels of a point, nan in a camera in whose image it is not. Shape (4,)."""
    pixels = rig.project(p_WH).reshape(2, 2)
    size = np.array([camera.image_size for camera in rig.cameras])
    inside = (pixels >= -0.5) & (pixels <= size - 0.5)  # a pixel's middle has whole numbers
    return np.where(inside.all(axis=1, keepdims=True), pixels, np.nan).ravel()
