"""The room about a simulated Nico: cards are seen where they hang, walls have paper."""

import cv2
import numpy as np
import pytest
from pydrake.math import RigidTransform

from nico_selfmodel.geometry.transform import apply, inverse
from nico_selfmodel.sessions.whole_body import cards_about_nico, room_about_nico
from nico_selfmodel.systems.looking import HEAD_JOINTS, looking_body
from nico_selfmodel.systems.nico_cameras import NICO_CAMERAS
from nico_selfmodel.systems.rendering.stereo_cameras import ImageQuality
from nico_selfmodel.systems.rendering.textured_card import textured_card
from nico_selfmodel.systems.simulated.imperfections import IMPERFECTIONS
from nico_selfmodel.systems.stations.nico_detectors import room_detectors
from nico_selfmodel.systems.stations.nico_station import NicoStation
from nico_selfmodel.systems.stations.station_body import StationBody
from nico_selfmodel.systems.stations.whole_nico import WholeNico
from nico_selfmodel.systems.tracking import shared_search
from nico_selfmodel.vision.printed_pattern import wallpaper_png


def test_wallpaper_is_the_same_for_the_same_seed_and_nowhere_plain():
    papers = [wallpaper_png((1.0, 1.0), seed) for seed in (0, 0, 1)]
    assert papers[0] == papers[1] != papers[2]
    picture = cv2.imdecode(np.frombuffer(papers[0], np.uint8), cv2.IMREAD_COLOR)
    assert picture.shape == (250, 250, 3)
    assert min(picture[k::4].std() for k in range(4)) > 25.0


def test_pictures_of_cards_are_files_of_different_names():
    """Renderers keep them by name: four cards of one name showed the same markers."""
    names = []
    for picture in (b"one", b"another", b"one"):
        card = textured_card("card", picture, (0.1, 0.1), RigidTransform(), 1)
        files = card.shape().source().in_memory().supporting_files
        names.append({name for name in files if name.endswith(".png")})
    assert names[0] == names[2]
    assert not names[0] & names[1]


@pytest.mark.slow
def test_markers_of_the_room_are_seen_where_they_hang():
    body, room = looking_body(*HEAD_JOINTS), room_about_nico()
    nico = WholeNico.build(body, IMPERFECTIONS["clean"], 3, NICO_CAMERAS)
    found = room_detectors(cards_about_nico(), nico.rig)
    detectors = {name: found[name] for name in room}
    sharp = ImageQuality(supersample=1, noise=0.0)
    with NicoStation(
        "clean", 3, arm=body, detectors=detectors, quality=sharp, room=cards_about_nico()
    ) as station:
        driven = StationBody(station, station.joints, station.tracked)
        seen = driven.move_and_measure(nico.mechanics.servos.to_encoder(np.zeros(6)))
    robot = nico.at(seen.encoders)
    expected = robot.rig.project(apply(inverse(robot.X_BL), np.array(list(room.values()))))
    measured = np.array([seen.pixels[name] for name in room])
    both = np.isfinite(measured) & np.isfinite(expected)
    assert both.sum() >= 4 * 6
    assert np.abs(measured - expected)[both].max() < 0.4


def test_detectors_of_one_family_search_a_picture_once(monkeypatch):
    searches = []
    search = shared_search.FiducialSearch.of
    monkeypatch.setattr(
        shared_search.FiducialSearch,
        "of",
        lambda image, *more, **how: searches.append(1) or search(image, *more, **how),
    )
    detectors = shared_search.fiducial_detectors({"a": 1, "b": 2}, {"c": 3})
    pictures = [np.full((60, 80, 3), 200, np.uint8) for _ in range(2)]
    for left, right in detectors.values():
        assert "no apriltag_36h11 marker" in left(pictures[0]).reason
        assert "no apriltag_36h11 marker" in right(pictures[1]).reason
    assert len(searches) == 2
