"""Body against room, by which cells of a picture look otherwise after each turn."""

import numpy as np
import pytest

from nico_selfmodel.estimation.contingency import body_or_room
from nico_selfmodel.estimation.contingency.body_or_room import CHANGES, tell_body


def told(turns, often):
    """What is said of one cell that shows something in all turns and changes in some."""
    shows = np.ones((turns, 1, 1), dtype=bool)
    return tell_body(shows, np.arange(turns)[:, None, None] < often)


def test_cells_are_told_at_a_hundred_to_one():
    assert told(3, 0).body.all()
    assert not told(2, 0).body.any()  # (0.95 / 0.1)^2 is 90
    assert told(2, 2).room.all()
    assert not told(1, 1).room.any()
    assert not told(4, 2).body.any()
    assert not told(4, 2).room.any()


def test_odds_are_those_of_two_coins():
    body, room = CHANGES
    expected = 3 * np.log(body / room) + 5 * np.log((1 - body) / (1 - room))
    assert told(8, 3).log_odds[0, 0] == pytest.approx(expected)


def test_what_shows_nothing_is_not_told():
    shows, changed = np.zeros((8, 4, 5), dtype=bool), np.ones((8, 4, 5), dtype=bool)
    found = tell_body(shows, changed)
    assert (found.log_odds == 0.0).all()
    assert not found.body.any()
    assert not found.room.any()


def test_of_cells_that_behave_as_is_stated_one_in_a_hundred_is_told_wrongly_at_most():
    rng = np.random.default_rng(5)
    body = np.arange(20000).reshape(100, 200) % 2 == 0
    changed = rng.random((8, 100, 200)) < np.where(body, *CHANGES)
    found = tell_body(np.ones_like(changed), changed)
    assert (found.body & ~body).sum() / found.body.sum() < 0.01
    assert (found.room & body).sum() / found.room.sum() < 0.01
    assert (found.body | found.room).mean() > 0.98


def test_a_threshold_that_moves_moves_what_is_told(monkeypatch):
    monkeypatch.setattr(body_or_room, "ODDS", 80.0)
    assert told(2, 0).body.all()


def test_series_that_do_not_belong_together_are_refused():
    shows = np.ones((3, 4, 5), dtype=bool)
    for changed in (shows[:2], shows[0]):
        with pytest.raises(ValueError, match=r"one shape \(K, rows, columns\)"):
            tell_body(shows, changed)
