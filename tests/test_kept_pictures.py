"""Pictures that are kept while a body is recorded, in which its markers are located anew."""

from types import MappingProxyType

import numpy as np
import pytest

from nico_selfmodel.recording.kept_pictures import KeptPictures, located_anew
from nico_selfmodel.sessions.whole_body import whole_body_session
from nico_selfmodel.systems.measurements import CameraMeasurement, Measurement
from nico_selfmodel.systems.simulated.imperfections import IMPERFECTIONS
from nico_selfmodel.vision.images.not_seen import NotSeen

NOWHERE = np.full(4, np.nan)


class _Body:
    """Shows one grey level a visit, and a marker in the visits that are told."""

    joints, markers = (), ("a",)

    def __init__(self, *seen, pictures=True):
        self._seen, self._pictures = iter(seen), pictures

    def move_and_measure(self, command):
        level, seen = int(command[0]), next(self._seen)
        picture = np.full((4, 5, 3), level, np.uint8)
        return CameraMeasurement(
            np.asarray(command, dtype=float),
            MappingProxyType({"a": None}),
            MappingProxyType({"a": np.ones(4) if seen else NOWHERE}),
            (picture, picture + 1) if self._pictures else None,
        )


def test_pictures_of_visits_in_which_something_was_seen_are_kept_in_their_order():
    body = KeptPictures(_Body(True, False, True))
    for level in (10, 20, 30):
        assert body.move_and_measure([level]).images is None
    assert [(left[0, 0], right[0, 0]) for left, right in body.pairs] == [(10, 11), (30, 31)]
    assert body.pairs[0][0].shape == (4, 5)
    assert body.markers == ("a",)


def test_a_body_that_shows_no_pictures_is_refused():
    with pytest.raises(ValueError, match="shows no pictures to keep"):
        KeptPictures(_Body(True, pictures=False)).move_and_measure([1])
    blind = type("Blind", (), {"move_and_measure": lambda self, c: Measurement(np.zeros(1), {})})
    with pytest.raises(ValueError, match="shows no pictures to keep"):
        KeptPictures(blind()).move_and_measure([1])


def test_markers_are_located_in_the_picture_of_their_own_pose_and_camera():
    data = whole_body_session(IMPERFECTIONS["clean"], 0, 0, looks=3, hands=0)
    table = data.observations
    pictures = [
        tuple(np.full((2, 2), 10 * pose + side, np.uint8) for side in range(2)) for pose in range(3)
    ]

    def detector(marker):
        def find(picture):
            if picture[0, 0] == 21:
                return NotSeen("too dark")
            return np.array([float(picture[0, 0]), float(marker)])

        return find

    detectors = {marker.name: detector(k) for k, marker in enumerate(data.markers)}
    found = located_anew(data, pictures, detectors).observations
    kept = ~((table.pose == 2) & (table.sensor == 1))
    assert 0 < kept.sum() < len(kept)
    assert found.pose.tolist() == table.pose[kept].tolist()
    assert found.values[:, 0].tolist() == (10.0 * table.pose + table.sensor)[kept].tolist()
    assert found.values[:, 1].tolist() == table.marker[kept].tolist()
