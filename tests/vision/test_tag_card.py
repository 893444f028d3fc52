"""Cards of markers: where each marker is, on the card, in the room and in print."""

import cv2
import numpy as np
import pytest

from nico_selfmodel.geometry.transform import transform
from nico_selfmodel.vision.markers.fiducial import FiducialSearch
from nico_selfmodel.vision.markers.tag_card import TagCard, markers_of
from nico_selfmodel.vision.printed_pattern import card_png


def test_a_printed_card_shows_each_marker_where_it_says():
    card = TagCard(20)
    picture = cv2.imdecode(np.frombuffer(card_png(card), np.uint8), cv2.IMREAD_GRAYSCALE)
    height, width = picture.shape
    assert height / width == pytest.approx(card.size[1] / card.size[0])
    found = {item.id: item.center for item in FiducialSearch.of(picture, mirrors=False).seen}
    assert sorted(found) == list(card.ids) == list(range(20, 26))
    x, y = (card.p_KT - card.middle)[:, :2].T * width / card.size[0]
    expected = np.column_stack([x, -y]) + 0.5 * np.array([width - 1, height - 1])
    assert np.array([found[k] for k in card.ids]) == pytest.approx(expected, abs=0.1)


def test_cards_number_their_markers_one_after_the_other():
    at = transform(np.eye(3), np.array([1.0, 2.0, 3.0]))
    named = markers_of([TagCard(20), TagCard(26, at)])
    assert list(named)[5:7] == ["card0_5", "card1_0"]
    assert named["card1_0"][0] == 26
    assert named["card1_0"][1] == pytest.approx(named["card0_0"][1] + [1.0, 2.0, 3.0])


@pytest.mark.parametrize("wrong", [{"columns": 0}, {"pitch": 0.09}, {"side": -1.0}])
def test_markers_that_do_not_fit_on_a_card_are_refused(wrong):
    with pytest.raises(ValueError, match="white cell around each"):
        TagCard(0, **wrong)
