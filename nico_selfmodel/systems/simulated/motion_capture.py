"""Motion capture: where an outside instrument sees markers, in a frame of its own."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike
from pydrake.systems.framework import BasicVector, Context, LeafSystem

from nico_selfmodel.arrays import frozen_array
from nico_selfmodel.geometry.transform import apply
from nico_selfmodel.systems.closing import Closable


class MotionCapture(Closable, LeafSystem):
    """Measures markers as the thesis' Vicon does: in its own frame, with noise and drop-outs.

    | port | | carries |
    |---|---|---|
    | `p_BH_true` | in | true positions, x y z of each marker in turn, in the base B [m] |
    | `p_WH_measured` | out | measured positions in the tracker's frame W, nan where lost [m] |
    | `frame_number` | out | how many frames were taken since time 0 |

    Positions are those of the moment at which they are asked for; noise and drop-outs depend on the
    seed and the frame's number, and stay the same within one frame.
    """

    def __init__(
        self,
        markers: Sequence[str],
        *,
        X_WB: ArrayLike | None = None,
        sigma: float = 0.0,
        dropout_share: float = 0.0,
        rate: float = 100.0,
        seed: int | tuple[int, ...] = 0,
    ) -> None:
        """Set the instrument up.

        Args:
            markers: Names of the markers, in the order of the ports.
            X_WB: The base in the tracker's frame; its own private business. Shape (4, 4).
            sigma: Noise of each coordinate [m].
            dropout_share: Share of measurements in which a marker is lost.
            rate: Frames a second [1/s].

        Raises:
            ValueError: If there are no markers or a number is out of range.
        """
        super().__init__()
        if not markers or len(set(markers)) != len(markers):
            raise ValueError(f"markers must have names of their own, got {list(markers)}")
        if not (sigma >= 0.0 and 0.0 <= dropout_share <= 1.0 and rate > 0.0):
            raise ValueError(
                "sigma must not be negative, dropout_share between 0 and 1, rate positive, got "
                f"{sigma}, {dropout_share} and {rate}"
            )
        self.markers, self.rate = tuple(markers), float(rate)
        self._sigma, self._dropout, self._seed = sigma, dropout_share, np.ravel(seed)
        self.__X_WB = frozen_array(np.eye(4) if X_WB is None else X_WB, (4, 4), "X_WB")
        size = 3 * len(self.markers)
        self._positions = self.DeclareVectorInputPort("p_BH_true", size)
        needs = {self._positions.ticket(), self.time_ticket()}
        self.DeclareVectorOutputPort("p_WH_measured", BasicVector(size), self._measure, needs)
        self.DeclareVectorOutputPort(
            "frame_number",
            BasicVector(1),
            lambda context, vector: vector.SetFromVector([self._frame(context)]),
            {self.time_ticket()},
        )

    def _frame(self, context: Context) -> int:
        self.require_open()
        # A frame begins a hair early, so that rounding never puts time n/rate into frame n - 1.
        return int(np.floor(context.get_time() * self.rate + 1e-6))

    def _measure(self, context: Context, vector: BasicVector) -> None:
        p_BH = np.reshape(self._positions.Eval(context), (-1, 3))
        frame = self._frame(context)
        # Time may begin before zero, seeds may not.
        rng = np.random.default_rng([*self._seed, 3 if frame >= 0 else 4, abs(frame)])
        p_WH = apply(self.__X_WB, p_BH) + rng.normal(0.0, 1.0, p_BH.shape) * self._sigma
        lost = rng.random(len(p_BH)) < self._dropout
        vector.SetFromVector(np.where(lost[:, None], np.nan, p_WH).ravel())
