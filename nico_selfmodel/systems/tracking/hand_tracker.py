"""Pairs of pictures in, pixels of what is marked on the hand out."""

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pydrake.common.value import AbstractValue
from pydrake.systems.framework import BasicVector, Context, InputPort, LeafSystem, ValueProducer

from nico_selfmodel.model.cameras.rig_parameters import SIDES
from nico_selfmodel.systems.image_values import bgr_of, image_value
from nico_selfmodel.vision.color.color_blob import find_color_blob
from nico_selfmodel.vision.color.color_model import ColorModel
from nico_selfmodel.vision.images.not_seen import NotSeen

Detector = Callable[[NDArray], NDArray | NotSeen]
"""From a picture (BGR, 8 bits, shape (h, w, 3)) to a pixel (u, v), or why there is none."""
Detectors = Mapping[str, Detector | tuple[Detector, Detector]]
"""Marker -> what finds it in a picture of either camera, or one for each."""
Found = NDArray | NotSeen
"""A pixel (u, v), or why there is none."""
MirrorDetector = Callable[[NDArray, NDArray], tuple[Found, Found]]
"""From a picture and the pixel where the marker is expected, nan where out of view or not known, to
the marker itself and its reflection."""
MirrorDetectors = Mapping[str, MirrorDetector | tuple[MirrorDetector, MirrorDetector]]
"""Marker -> what finds both in a picture of either camera, or one for each."""

RED_TAPE = ColorModel("red", (20.0, 20.0), 0.0, 20.0, 0.5, least_area_px=25.0)
"""Nico's red tape in the light of the simulated room."""
FIDUCIAL_ID = 7
"""Which marker of the family is printed for Nico's hand."""


def color_detector() -> Detector:
    """Return a detector of the middle of the largest patch of the red tape's colour."""

    def detect(image: NDArray) -> NDArray | NotSeen:
        found = find_color_blob(image, RED_TAPE)
        return found if isinstance(found, NotSeen) else found.center

    return detect


class HandTracker(LeafSystem):
    """Looks for marked points in both pictures.

    | port | | carries |
    |---|---|---|
    | `left_image` | in | picture of the left camera, `ImageRgba8U` |
    | `right_image` | in | picture of the right camera, `ImageRgba8U` |
    | `pixels` | out | left u, v and right u, v of each marker in turn, nan where not seen [px] |
    | `seen` | out | 1 where a camera sees a marker, else 0: left and right of each marker in turn |
    | `reasons` | out | in words, why one was not seen: a tuple, empty text where it was seen |

    A tracker before a mirror has four ports more:

    | port | | carries |
    |---|---|---|
    | `pixels_predicted` | in | where the body expects the markers, nan for nowhere [px] |
    | `reflected_pixels` | out | as `pixels`, of the reflections [px] |
    | `reflected_seen` | out | as `seen`, of the reflections |
    | `reflected_reasons` | out | as `reasons`, of the reflections |

    A detector that sees nothing says so: there is never a pixel that nobody saw.
    """

    def __init__(
        self,
        detectors: Detectors | MirrorDetectors,
        *,
        before_mirror: bool = False,
    ) -> None:
        """Choose what to look for.

        Args:
            detectors: Marker -> what finds it, for either camera or for each.
            before_mirror: Look for reflections too; the detectors are then `MirrorDetectors`, as
                `reflection_detectors` makes them.

        Raises:
            ValueError: If there is nothing to look for.
        """
        super().__init__()
        if not detectors:
            raise ValueError("a tracker needs at least one marker to look for")
        self.markers = tuple(detectors)
        pairs: Any = [d if isinstance(d, tuple) else (d, d) for d in detectors.values()]
        self._detectors = pairs
        self._images = [
            # A value tells only the type, and lives as long as the system: a small one does.
            self.DeclareAbstractInputPort(f"{camera}_image", image_value(1, 1))
            for camera in SIDES
        ]
        self._expected: InputPort | None = None
        needs = {port.ticket() for port in self._images}
        if before_mirror:
            width = 4 * len(self.markers)
            self._expected = self.DeclareVectorInputPort("pixels_predicted", width)
            needs.add(self._expected.ticket())
        self._found = self.DeclareCacheEntry(
            "detections",
            ValueProducer(lambda: AbstractValue.Make([]), self._detect),
            needs,
        )
        for kind in range(2 if before_mirror else 1):
            self._declare_outputs(kind)

    def _declare_outputs(self, kind: int) -> None:
        """Declare the ports of the markers themselves (0) or of their reflections (1)."""
        prefix, m, needs = ("", "reflected_")[kind], len(self.markers), {self._found.ticket()}

        def pixels(context: Context, vector: BasicVector) -> None:
            nowhere, found = np.full(2, np.nan), self._detections(context, kind)
            vector.SetFromVector(
                np.concatenate([nowhere if isinstance(f, NotSeen) else f for f in found])
            )

        def seen(context: Context, vector: BasicVector) -> None:
            found = self._detections(context, kind)
            vector.SetFromVector([float(not isinstance(f, NotSeen)) for f in found])

        def reasons(context: Context, value: AbstractValue) -> None:
            found = self._detections(context, kind)
            value.set_value(tuple(f.reason if isinstance(f, NotSeen) else "" for f in found))

        self.DeclareVectorOutputPort(f"{prefix}pixels", BasicVector(4 * m), pixels, needs)
        self.DeclareVectorOutputPort(f"{prefix}seen", BasicVector(2 * m), seen, needs)
        self.DeclareAbstractOutputPort(
            f"{prefix}reasons", lambda: AbstractValue.Make(()), reasons, needs
        )

    def _detect(self, context: Context, value: AbstractValue) -> None:
        """Run every detector on both pictures: each marker and its reflection in each camera."""
        pictures = [bgr_of(port.Eval(context)) for port in self._images]
        if self._expected is None:
            found = [
                (find(picture),)
                for pair in self._detectors
                for find, picture in zip(pair, pictures, strict=True)
            ]
        else:
            expected = self._expected_pixels(context)
            found = [
                find(picture, expected[2 * marker + camera])
                for marker, pair in enumerate(self._detectors)
                for camera, (find, picture) in enumerate(zip(pair, pictures, strict=True))
            ]
        value.set_value(found)

    def _expected_pixels(self, context: Context) -> NDArray:
        """Return where each marker itself is expected in each camera. Shape (2 m, 2)."""
        port = self._expected
        if port is None or not port.HasValue(context):
            return np.full((2 * len(self.markers), 2), np.nan)
        return np.asarray(port.Eval(context), dtype=float).reshape(-1, 2)

    def _detections(self, context: Context, kind: int) -> list[Found]:
        detections: Any = self._found.Eval(context)
        return [found[kind] for found in detections]
