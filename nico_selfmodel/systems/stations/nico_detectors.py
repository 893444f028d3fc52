"""What finds Nico's hands, its finger and cards in a room in the pictures of its cameras."""

from collections.abc import Sequence

from nico_selfmodel.model.cameras.stereo_rig import StereoRig
from nico_selfmodel.systems.tracking.hand_tracker import (
    FIDUCIAL_ID,
    Detectors,
    MirrorDetectors,
    color_detector,
)
from nico_selfmodel.systems.tracking.shared_search import fiducial_detectors, fiducials_in_mirror
from nico_selfmodel.vision.markers.tag_card import TagCard, markers_of

FIDUCIALS = {"right": FIDUCIAL_ID, "left": FIDUCIAL_ID + 1}
"""Which marker of the family is printed for each hand of a whole Nico."""


def default_detectors(rig: StereoRig | None = None) -> Detectors:
    """Return detectors of the fiducial on the back of Nico's hand and of the tape on its finger.

    Args:
        rig: The calibrated cameras, whose lenses are then taken out before fiducials are located.
    """
    fiducial = fiducial_detectors({"fiducial": FIDUCIAL_ID}, rig=rig)
    return {**fiducial, "finger_tip": color_detector()}


def body_detectors() -> Detectors:
    """Return detectors of the fiducials on both of Nico's hands and of the tape on its finger."""
    numbers = {f"{side}_hand_fiducial": number for side, number in FIDUCIALS.items()}
    return {**fiducial_detectors(numbers), "right_finger_tip": color_detector()}


def room_detectors(room: Sequence[TagCard], rig: StereoRig | None = None) -> Detectors:
    """Return detectors of the corners of both hands' fiducials and of cards in the room.

    Args:
        rig: The calibrated cameras, whose lenses are then taken out before points are located.
    """
    return fiducial_detectors(*_in_room(room), rig=rig)


def room_mirror_detectors(room: Sequence[TagCard], rig: StereoRig | None = None) -> MirrorDetectors:
    """Return detectors of the same, and of their reflections.

    Args:
        rig: As in `room_detectors`.
    """
    return fiducials_in_mirror(*_in_room(room), rig=rig)


def _in_room(room: Sequence[TagCard]) -> tuple[dict[str, int], dict[str, int]]:
    """Return ids of markers whose centres are wanted, and of those whose corners are, by name."""
    centers = {name: number for name, (number, _) in markers_of(room).items()}
    return centers, {f"{side}_hand_fiducial": number for side, number in FIDUCIALS.items()}
