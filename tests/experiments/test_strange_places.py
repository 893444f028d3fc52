"""What looks strange of an unmarked body, and what is left out about a card on its hand."""

from types import SimpleNamespace

import numpy as np
import pytest

from nico_selfmodel.sessions.looks import mirror_looks
from nico_selfmodel.sessions.looks.card import Card
from nico_selfmodel.sessions.looks.mirror_looks import MirrorLooks

CHEST, ARM = 3, 7
STRANGE = (4, 5)


@pytest.mark.parametrize("order", [(CHEST, ARM), (ARM, CHEST)])
def test_what_is_strange_of_the_body_stays_so_where_the_arm_is_in_another_look(order, monkeypatch):
    looks = object.__new__(MirrorLooks)
    looks._image = SimpleNamespace(moving=frozenset({ARM}), links={CHEST: "chest", ARM: "arm"})
    expecting = SimpleNamespace(expected=lambda side, expected, arm: expected)
    monkeypatch.setattr(MirrorLooks, "_expecting", lambda *_: expecting)
    chi_square = np.zeros((8, 9))
    chi_square[STRANGE] = 60.0
    monkeypatch.setattr(mirror_looks, "surprise", lambda *_: SimpleNamespace(chi_square=chi_square))
    monkeypatch.setattr(mirror_looks, "log_likelihood", lambda *_: np.zeros((8, 9)))
    seen = [
        SimpleNamespace(
            side=0, picture=None, arm=None, expected=SimpleNamespace(labels=np.full((8, 9), link))
        )
        for link in order
    ]
    told = looks._told(seen, 0.01)
    assert (told.strange[:, 0][:, *STRANGE] == CHEST).all()
    assert np.count_nonzero(told.strange >= 0) == len(told.strange)


def test_what_is_left_out_about_a_card_reaches_into_the_hand_and_little_before_it():
    """The surface that it stands on is below it, of a card that is seen along -z."""
    half = 0.01
    corners = half * np.array([[-1.0, 1, 0], [1, 1, 0], [1, -1, 0], [-1, -1, 0]])
    block = Card.of_corners(corners).block
    assert block[:, 2].min() == pytest.approx(-10e-3)
    assert block[:, 2].max() == pytest.approx(4e-3)
