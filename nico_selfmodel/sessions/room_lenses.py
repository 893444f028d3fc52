"""Lenses of cameras from cards of markers in a room, each of which is a board.

Where a lens is not known yet a marker's centre is found as if its edges were straight, up to half a
pixel wrong near the border of a wide picture. So markers are located once more behind the lenses
that were found, in the same pictures, before anything is learned from them.
"""

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.dataset.board_views import BoardViews
from nico_selfmodel.dataset.body.body_dataset import BodyDataset
from nico_selfmodel.dataset.body.sensors import CAMERA
from nico_selfmodel.errors import DataError
from nico_selfmodel.estimation.cameras.camera_adjustment import CameraCalibration
from nico_selfmodel.estimation.cameras.camera_calibration import calibrate_cameras
from nico_selfmodel.model.cameras.camera import Camera
from nico_selfmodel.model.cameras.stereo_rig import StereoRig
from nico_selfmodel.recording.kept_pictures import KeptPictures, located_anew
from nico_selfmodel.recording.session import Progress
from nico_selfmodel.sessions.rendered_body import RenderedBody
from nico_selfmodel.systems.stations.station_body import StationBody
from nico_selfmodel.vision.markers.tag_card import TagCard, markers_of

_FEWEST = 5
"""Markers of a card that a camera must see."""


def look_about(
    robot: RenderedBody, looks: int, progress: Progress | None = None
) -> tuple[BodyDataset, Mapping[str, CameraCalibration]]:
    """Let a robot look about its room, of whose lenses nothing is known.

    Args:
        robot: With cards of markers about it.
        looks: Poses of its head.

    Returns:
        What its cameras saw of the cards, located behind the lenses that this tells, and the
        calibration of each camera by its name.

    Raises:
        DataError: If nothing was seen.
        EstimationError: If a camera saw too few of the cards.
    """
    seen: list[KeptPictures] = []

    def watch(body: StationBody) -> KeptPictures:
        seen.append(KeptPictures(body))
        return seen[0]

    data = robot.record("looks", 0, looks, 0, progress=progress, watch=watch)
    cards = robot.whole.cards
    first = lenses_of(_lenses_from_cards(data, cards))
    behind = robot.whole.detectors(StereoRig(*first.values()))
    data = located_anew(data, seen[0].pairs, behind)
    return data, _lenses_from_cards(data, cards)


def lenses_of(found: Mapping[str, CameraCalibration]) -> dict[str, Camera]:
    """Return the lens of each camera that was calibrated alone, by its name."""
    return {name: calibration.cameras[0] for name, calibration in found.items()}


def _lenses_from_cards(
    data: BodyDataset, cards: Sequence[TagCard]
) -> Mapping[str, CameraCalibration]:
    """Calibrate each camera alone: every card in every picture is a view of one board.

    Where the cards, all of one layout, hang does not matter.

    Raises:
        DataError: If a camera has no image size.
        EstimationError: If a camera saw too few of the cards.
    """
    return {
        info.name: calibrate_cameras(_views(data, s, cards))
        for s, info in enumerate(data.sensors)
        if info.kind == CAMERA
    }


def _views(data: BodyDataset, sensor: int, cards: Sequence[TagCard]) -> BoardViews:
    """Return one camera's views of the cards."""
    info = data.sensors[sensor]
    if info.image_size is None:
        raise DataError(f"camera {info.name!r} has no 'image_size' [px]: put it into dataset.yaml")
    names, size = [marker.name for marker in data.markers], len(cards[0].ids)
    of_card = np.full((len(names), 2), -1)
    for k, name in enumerate(markers_of(cards)):
        if name in names:
            of_card[names.index(name)] = divmod(k, size)
    table = data.observations
    card, corner = of_card[table.marker].T
    own = (table.sensor == sensor) & (card >= 0)
    pixels: NDArray = np.full((len(data.sample), len(cards), size, 2), np.nan)
    pixels[table.pose[own], card[own], corner[own]] = table.values[own, :2]
    seen = np.isfinite(pixels[..., 0]).sum(axis=2) >= _FEWEST
    views = [f"{data.sample[pose]}_{c}" for pose, c in np.argwhere(seen)]
    return BoardViews(cards[0].p_KT, tuple(views), (info.name,), pixels[seen], (info.image_size,))
