"""Telling a marked hand from its reflection in one picture.

A fiducial says which it is: its reflection is a mirror image of a marker, which is none. A patch of
colour does not: the body must know where its hand should be seen, and what else has the colour is
the reflection.
"""

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.model.cameras.stereo_rig import StereoRig
from nico_selfmodel.systems.tracking.hand_tracker import (
    FIDUCIAL_ID,
    RED_TAPE,
    Found,
    MirrorDetector,
    MirrorDetectors,
)
from nico_selfmodel.systems.tracking.shared_search import fiducials_in_mirror
from nico_selfmodel.vision.color.color_blob import ColorBlob, color_blobs
from nico_selfmodel.vision.images.not_seen import NotSeen

_GATE = 40.0
"""A patch farther from where the hand is expected is not the hand [px]."""


def color_in_mirror() -> MirrorDetector:
    """Return a detector of the middles of the red tape and of its reflection.

    Returns:
        What finds both. Where the hand should be in view but no patch is near, nothing is vouched
        for: what is seen may be either.
    """

    def detect(image: NDArray, expected: NDArray) -> tuple[Found, Found]:
        blobs = [b for b in color_blobs(image, RED_TAPE) if b.area_px >= RED_TAPE.least_area_px]
        if not blobs:
            nothing = NotSeen(f"no patch of the colour with {RED_TAPE.least_area_px:g} pixels")
            return nothing, nothing
        if not _in_view(expected, image.shape, _GATE):
            return NotSeen("the hand itself is out of view"), _patch(blobs)
        away = np.array([np.linalg.norm(b.centroid - expected) for b in blobs])
        near = np.flatnonzero(away <= _GATE)
        if len(near) != 1:
            count = "no patch" if not len(near) else f"{len(near)} patches"
            vague = NotSeen(
                f"{count} of the colour within {_GATE:g} px of where the hand is expected: which "
                "is the hand and which its reflection is not to be told"
            )
            return vague, vague
        others = [b for k, b in enumerate(blobs) if k != near[0]]
        return _patch([blobs[near[0]]]), _patch(others)

    return detect


def default_mirror_detectors(rig: StereoRig | None = None) -> MirrorDetectors:
    """Return detectors of what Nico's hand carries, and of its reflections.

    Args:
        rig: The calibrated cameras, whose lenses are then taken out before fiducials are located.
    """
    fiducial = fiducials_in_mirror({"fiducial": FIDUCIAL_ID}, {}, rig=rig)
    return {**fiducial, "finger_tip": color_in_mirror()}


def _in_view(expected: NDArray, shape: tuple[int, ...], gate: float) -> bool:
    """Return whether a patch that is expected somewhere may show in a picture."""
    far = np.array(shape[1::-1]) - 1.0 + gate
    return bool(((expected >= -gate) & (expected <= far)).all())


def _patch(blobs: list[ColorBlob]) -> Found:
    """Return the middle of the largest patch, unless it is not to be trusted."""
    if not blobs:
        return NotSeen("no other patch of the colour: no reflection in view")
    blob = blobs[0]
    if len(blobs) > 1:
        u, v = blobs[1].centroid
        return NotSeen(f"another patch of the colour at ({u:.0f}, {v:.0f}): which is meant?")
    if blob.touches_border:
        return NotSeen("the patch is cut by the border of the image: its centre is not known")
    return blob.center
