"""Cards of a room as a file: what it says, and what is refused."""

import numpy as np
import pytest
import yaml

from nico_selfmodel.errors import DataError
from nico_selfmodel.sessions.whole_body import cards_about_nico
from nico_selfmodel.vision.markers.tag_card_file import load_cards

CARD = {"first": 20, "xyz_m": [0.7, 0.0, 0.3], "rpy_deg": [90, 0, -90]}
FILE = {"format": "nico-cards/1", "cards": [CARD]}


def written(tmp_path, content):
    path = tmp_path / "room.yaml"
    path.write_text(yaml.safe_dump(content))
    return path


def test_the_sample_hangs_where_the_simulated_room_does(project_root):
    found = load_cards(project_root / "examples" / "nico_room.yaml", taken=(7, 8))
    assert [card.first for card in found] == [card.first for card in cards_about_nico()]
    for card, there in zip(found, cards_about_nico(), strict=True):
        assert np.abs(card.p_WT - there.p_WT).max() < 2e-4


def test_a_card_hangs_as_a_urdfs_origin_says(tmp_path):
    (card,) = load_cards(written(tmp_path, FILE))
    # Rolled upright, then turned to face against the robot's x axis.
    assert card.X_WK[:3, 2] == pytest.approx([-1.0, 0.0, 0.0], abs=1e-12)
    assert card.X_WK[:3, 1] == pytest.approx([0.0, 0.0, 1.0], abs=1e-12)
    assert card.p_WT[:, 2] == pytest.approx([0.3, 0.42] * 3)
    other = {**CARD, "columns": 1, "rows": 3, "side_mm": 40, "pitch_mm": 60}
    (card,) = load_cards(written(tmp_path, {**FILE, "cards": [other]}))
    assert len(card.ids) == 3
    assert card.p_WT[:, 2] == pytest.approx([0.3, 0.36, 0.42])


@pytest.mark.parametrize(
    ("content", "said"),
    [
        ({"cards": [CARD]}, "nico-cards/1"),
        ({**FILE, "cards": []}, "one entry a card"),
        ({**FILE, "cards": [{**CARD, "rotated": 1}]}, "unknown key 'rotated'"),
        ({**FILE, "cards": [{**CARD, "first": None}]}, "'first' must be the id"),
        ({**FILE, "cards": [{**CARD, "xyz_m": [0, 0]}]}, "'xyz_m' must be three numbers"),
        ({**FILE, "cards": [{**CARD, "rpy_deg": [0, 0, "up"]}]}, "'rpy_deg' must be a finite"),
        ({**FILE, "cards": [{**CARD, "side_mm": 200}]}, "white cell around"),
        ({**FILE, "cards": [{**CARD, "family": "odd"}]}, "no marker family 'odd'"),
        ({**FILE, "cards": [CARD, {**CARD, "first": 24}]}, "24, 25 would be there twice"),
        ({**FILE, "cards": [{**CARD, "first": 3}]}, "7, 8 would be there twice"),
    ],
)
def test_what_is_no_room_is_refused_with_its_place(tmp_path, content, said):
    with pytest.raises(DataError, match=r"room\.yaml") as refused:
        load_cards(written(tmp_path, content), taken=(7, 8))
    assert said in str(refused.value)
