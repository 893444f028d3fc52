"""Looking at images of one's own hand: in a mirror, on a screen, or of who imitates it."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.estimation.contingency.image_witness import FEWEST, HandImages
from nico_selfmodel.model.cameras.rig_parameters import SIDES
from nico_selfmodel.model.self_model import SelfModel
from nico_selfmodel.systems.rendering.mirror_scene import put_mirror
from nico_selfmodel.systems.stations.nico_detectors import FIDUCIALS
from nico_selfmodel.systems.stations.nico_station import NicoStation
from nico_selfmodel.systems.stations.station_body import StationBody
from nico_selfmodel.systems.tracking.shared_search import fiducials_in_mirror
from nico_selfmodel.vision.images.not_seen import NotSeen

_MARKER = "fiducial"
_POSES = 30
_OWN = 40.0
"""A marker this near to where the own hand should be seen directly is that [px]."""


def watch_images(
    station: NicoStation,
    model: SelfModel,
    commands: Sequence[NDArray],
    enough: int,
    *,
    X_BM: NDArray | None = None,
    X_WO: NDArray | None = None,
) -> HandImages:
    """Go to poses and see where else the hand's marker is seen than on the own hand.

    Args:
        station: Open, with a mirror or a screen and a second robot; it is not closed here.
        model: What the robot has learned of arm and cameras.
        commands: Where to go [encoder units]. Shape (n,) each.
        enough: Images to see; then it ends. After thirty poses as many as a verdict takes do.
        X_BM: Where the mirror or screen stands, in the frame of the arm's base; away if omitted.
            Shape (4, 4).
        X_WO: Where a second robot stands that imitates the first at once; away if omitted.
            Shape (4, 4).
    """
    body = StationBody(station, station.joints, station.tracked)
    put_mirror(station, body.context, X_BM)
    station.stand_other(body.context, X_WO)
    find = fiducials_in_mirror({_MARKER: FIDUCIALS["right"]}, {}, rig=model.rig)[_MARKER]
    readings, pixels, mirrored, directly = [], [], [], []
    for k, command in enumerate(commands):
        if len(pixels) >= (enough if k < _POSES else FEWEST):
            break
        station.GetInputPort("other_commanded").FixValue(body.context, command)
        body.relive(command)
        now = np.array(station.GetOutputPort("encoders").Eval(body.context), dtype=float)
        pictures = [station.picture(body.context, side) for side in SIDES]
        own = model.rig.project(model.points(model.servos.to_joint(now[None]))[0])
        both = [
            one(picture, own[2 * i : 2 * i + 2])
            for i, (one, picture) in enumerate(zip(find, pictures, strict=True))
        ]
        hand = np.full(4, np.nan)
        for turned in (False, True):
            left, right = (pair[int(turned)] for pair in both)
            if isinstance(left, NotSeen) or isinstance(right, NotSeen):
                continue
            found = np.concatenate([left, right])
            if not turned and np.abs(found - own).max() < _OWN:
                hand = found
                continue
            readings.append(now)
            pixels.append(found)
            mirrored.append(turned)
            directly.append(hand)
    n = len(station.joints)
    return HandImages(
        station.joints,
        _MARKER,
        np.reshape(readings, (-1, n)),
        np.reshape(pixels, (-1, 4)),
        np.array(mirrored, dtype=bool),
        np.reshape(directly, (-1, 4)),
    )
