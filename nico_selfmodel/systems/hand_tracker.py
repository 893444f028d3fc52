"""Pairs of pictures in, pixels of what is marked on the hand out."""

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pydrake.common.value import AbstractValue
from pydrake.systems.framework import BasicVector, Context, LeafSystem, ValueProducer

from nico_selfmodel.model import Camera
from nico_selfmodel.model.stereo_rig import EYES
from nico_selfmodel.systems.image_values import bgr_of, image_value
from nico_selfmodel.vision.color_blob import find_color_blob
from nico_selfmodel.vision.color_model import ColorModel
from nico_selfmodel.vision.fiducial import find_fiducial
from nico_selfmodel.vision.fiducial_behind_lens import center_behind_lens
from nico_selfmodel.vision.fiducial_family import DEFAULT_FAMILY
from nico_selfmodel.vision.not_seen import NotSeen

Detector = Callable[[NDArray], NDArray | NotSeen]
"""From a picture (BGR, 8 bits, shape (h, w, 3)) to a pixel (u, v), or why there is none."""
Detectors = Mapping[str, Detector | tuple[Detector, Detector]]
"""Marker -> what finds it in a picture of either eye, or one for the left and one for the right."""

RED_TAPE = ColorModel("red", (20.0, 20.0), 0.0, 20.0, 0.5, least_area_px=25.0)
"""Nico's red tape in the light of the simulated room."""
FIDUCIAL_ID = 7
"""Which marker of the family is printed for Nico's hand."""


def fiducial_detector(
    marker: int = FIDUCIAL_ID, family: str = DEFAULT_FAMILY, camera: Camera | None = None
) -> Detector:
    """Return a detector of the centre of a square marker.

    Args:
        marker: Its id.
        family: Its family.
        camera: The calibrated eye, whose lens is then taken out before the centre is located.

    Returns:
        What finds the centre in a picture.
    """

    def detect(image: NDArray) -> NDArray | NotSeen:
        found = find_fiducial(image, family, marker, mirrored=False)
        if isinstance(found, NotSeen):
            return found
        return found.center if camera is None else center_behind_lens(image, found, camera)

    return detect


def color_detector(model: ColorModel = RED_TAPE) -> Detector:
    """Return a detector of the middle of the largest patch of a colour."""

    def detect(image: NDArray) -> NDArray | NotSeen:
        found = find_color_blob(image, model)
        return found if isinstance(found, NotSeen) else found.center

    return detect


class HandTracker(LeafSystem):
    """Looks for marked points in both pictures.

    | port | | carries |
    |---|---|---|
    | `left_image` | in | picture of the left eye, `ImageRgba8U` |
    | `right_image` | in | picture of the right eye, `ImageRgba8U` |
    | `pixels` | out | left u, v and right u, v of each marker in turn, nan where not seen [px] |
    | `seen` | out | 1 where an eye sees a marker, else 0: left and right of each marker in turn |
    | `reasons` | out | in words, why one was not seen: a tuple, empty text where it was seen |

    A detector that sees nothing says so: there is never a pixel that nobody saw.
    """

    def __init__(self, detectors: Detectors, image_size: tuple[int, int] = (640, 480)) -> None:
        """Choose what to look for.

        Args:
            detectors: Marker -> what finds it, for either eye or for each.
            image_size: Width and height of the pictures [px].

        Raises:
            ValueError: If there is nothing to look for.
        """
        super().__init__()
        if not detectors:
            raise ValueError("a tracker needs at least one marker to look for")
        self.markers = tuple(detectors)
        self._detectors = [d if isinstance(d, tuple) else (d, d) for d in detectors.values()]
        self._images = [
            self.DeclareAbstractInputPort(f"{eye}_image", image_value(*image_size)) for eye in EYES
        ]
        found = self.DeclareCacheEntry(
            "detections",
            ValueProducer(lambda: AbstractValue.Make([]), self._detect),
            {port.ticket() for port in self._images},
        )
        self._found = found
        needs = {found.ticket()}
        m = len(self.markers)
        self.DeclareVectorOutputPort("pixels", BasicVector(4 * m), self._pixels, needs)
        self.DeclareVectorOutputPort("seen", BasicVector(2 * m), self._seen, needs)
        self.DeclareAbstractOutputPort(
            "reasons", lambda: AbstractValue.Make(()), self._reasons, needs
        )

    @classmethod
    def fiducial(cls, marker: int = FIDUCIAL_ID, name: str = "fiducial") -> "HandTracker":
        """Return a tracker of a square marker."""
        return cls({name: fiducial_detector(marker)})

    @classmethod
    def color(cls, model: ColorModel = RED_TAPE, name: str = "finger_tip") -> "HandTracker":
        """Return a tracker of a patch of colour."""
        return cls({name: color_detector(model)})

    def _detect(self, context: Context, value: AbstractValue) -> None:
        """Run every detector on both pictures: a list by marker, then by eye."""
        pictures = [bgr_of(port.Eval(context)) for port in self._images]
        value.set_value(
            [
                [find(picture) for find, picture in zip(pair, pictures, strict=True)]
                for pair in self._detectors
            ]
        )

    def _detections(self, context: Context) -> list[NDArray | NotSeen]:
        detections: Any = self._found.Eval(context)
        return [found for pair in detections for found in pair]

    def _pixels(self, context: Context, vector: BasicVector) -> None:
        nowhere = np.full(2, np.nan)
        found = self._detections(context)
        vector.SetFromVector(
            np.concatenate([nowhere if isinstance(f, NotSeen) else np.asarray(f) for f in found])
        )

    def _seen(self, context: Context, vector: BasicVector) -> None:
        found = self._detections(context)
        vector.SetFromVector([float(not isinstance(f, NotSeen)) for f in found])

    def _reasons(self, context: Context, value: AbstractValue) -> None:
        found = self._detections(context)
        value.set_value(tuple(f.reason if isinstance(f, NotSeen) else "" for f in found))
