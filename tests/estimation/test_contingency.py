"""Self told from others by the timing of motion alone, on motion that is drawn, not rendered."""

from dataclasses import replace

import numpy as np
import pytest

from nico_selfmodel.errors import NotIdentifiableError
from nico_selfmodel.estimation.contingency.contingency import (
    CANNOT_TELL,
    NOBODY,
    NOT_ME,
    ODDS,
    SELF,
    tell_contingency,
)
from nico_selfmodel.estimation.contingency.motion_response import (
    LITTLE,
    MUCH,
    STILL,
    MotionResponse,
    learn_response,
)

from ..slow_rest import slow_rest

PERIOD, DELAY = 0.05, 3
STARTS, STAYS = 0.1, 0.88
MISSED, FALSE = 0.02, 0.01


def motion(count, rng):
    """Return whether something moves that starts and stops at random."""
    moving, draws = [False], rng.random(count)
    for draw in draws[1:]:
        moving.append(bool(draw < (STAYS if moving[-1] else STARTS)))
    return np.array(moving)


def seen(moving, delay, rng):
    """Return what is seen of a motion some pictures later, with mistakes."""
    late = np.concatenate([np.zeros(delay, dtype=bool), moving[: len(moving) - delay]])
    return np.where(rng.random(len(late)) < np.where(late, MISSED, FALSE), ~late, late)


def learned(seed=0, count=400):
    rng = np.random.default_rng((seed, 1))
    own = motion(count, rng)
    nobody = rng.random(count) < FALSE
    return learn_response(MUCH * own, seen(own, DELAY, rng), nobody, PERIOD)


RESPONSE = learned()


def met(kind, seed, count=200):
    """Return what is said of one encounter of ten seconds."""
    rng = np.random.default_rng((seed, 2))
    own = motion(count + 100, rng)
    if kind == "self":
        image = seen(own, DELAY, rng)
    elif kind == "self, hidden now and then":
        shown = np.repeat(rng.random(1 + (count + 100) // 20) < 0.75, 20)[: count + 100]
        image = seen(own & shown, DELAY, rng)
    elif kind == "other":
        image = seen(motion(count + 100, rng), DELAY, rng)
    elif kind == "nobody":
        image = rng.random(count + 100) < FALSE
    else:
        image = seen(own, DELAY + kind, rng)
    return tell_contingency(MUCH * own[100:], image[100:], RESPONSE)


def test_the_delay_of_ones_own_pictures_is_learned():
    for seed in range(20):
        response = learned(seed)
        # The picture shows one reading: its pair may hold the one before or after as well.
        assert response.delay in (DELAY - 1, DELAY)
        assert response.seen[MUCH, MUCH] > 0.9
        assert response.seen[STILL, STILL] < 0.1


def test_a_delay_between_two_pictures_is_learned_too():
    rng = np.random.default_rng(5)
    own = motion(400, rng)
    both = seen(own, DELAY, rng) | seen(own, DELAY + 1, rng)
    response = learn_response(MUCH * own, both, np.zeros(400), PERIOD)
    assert response.delay == DELAY
    moved = response.seen[np.ix_([STILL, MUCH], [STILL, MUCH])]
    assert moved.ravel()[1:].min() > 0.9


def coming_to_rest(moving):
    """Return m_t of joints that move on a little, for two pictures, after each way."""
    m = MUCH * moving
    for late in (1, 2):
        after = np.concatenate([np.zeros(late, dtype=bool), moving[:-late]])
        m = np.where((m == STILL) & after, LITTLE, m)
    return m


def test_who_comes_to_rest_slowly_is_not_ruled_out_by_what_little_of_it_is_seen():
    seconds = []
    for seed in range(50):
        rng = np.random.default_rng((seed, 6))
        own = coming_to_rest(motion(700, rng))
        visible = (own == MUCH) | ((own == LITTLE) & (rng.random(700) < 0.5))
        image = seen(visible, DELAY, rng)
        response = learn_response(own[:400], image[:400], np.zeros(400), PERIOD)
        assert 0.2 < response.seen[LITTLE, LITTLE] < 0.9
        found = tell_contingency(own[400:500], image[400:500], response)
        assert found.verdict == SELF
        seconds.append(found.seconds)
    assert np.median(seconds) < 2.5


@pytest.mark.parametrize(
    ("kind", "verdicts", "within"),
    slow_rest(
        [
            ("self", {SELF}, 5.0),
            ("other", {NOT_ME}, 10.0),
            ("nobody", {NOBODY, NOT_ME}, 10.0),
            (2, {NOT_ME}, 10.0),
            (6, {NOT_ME}, 10.0),
            (20, {NOT_ME}, 10.0),
            (100, {NOT_ME}, 10.0),
        ],
        plain=2,
    ),
)
def test_a_hundred_encounters_of_a_kind_are_all_told_in_time(kind, verdicts, within):
    found = [met(kind, seed) for seed in range(100)]
    assert {one.verdict for one in found} <= verdicts
    assert max(one.seconds for one in found) < within


@pytest.mark.parametrize("late", [2, 6, 8])
def test_a_pause_of_ones_own_says_nothing_against_who_repeats_ones_motion(late):
    rates = np.array([[0.003, 0.5, 0.33], [0.27, 0.75, 0.6], [0.96, 0.98, 0.996]])
    response = MotionResponse(PERIOD, 0, rates, 0.00125, 0.5, 0.147, 0.837)
    m = np.array([STILL] * 46 + [MUCH] * 3 + [STILL] * 3 + [MUCH] * 5 + [STILL] * 9)
    image = np.concatenate([np.zeros(1 + late, dtype=bool), m[: len(m) - 1 - late] == MUCH])
    image[47] = True  # a false alarm, as oneself starts
    told = [tell_contingency(m[:k], image[:k], response) for k in range(len(m))]
    assert SELF not in {one.verdict for one in told}
    # A chain alone, that starts as often as oneself, lost 7.3 by the pause: self was told, at 10.5,
    # where the other came 8 pictures later.
    assert told[-1].log_odds.max() < 7.5


def test_who_starts_and_stops_as_oneself_does_by_chance_is_not_taken_for_oneself():
    rates = np.array([[0.004, 0.5, 0.734], [0.083, 0.75, 0.375], [0.3, 0.976, 0.997]])
    response = MotionResponse(PERIOD, 0, rates, 0.00125, 0.5, 0.183, 0.846)
    # Another simulated robot, as it came.
    m = "2222200000000000000002222222222222222222222222222212222222022000222222222222100000022222"
    y = "1100000000000000000000000011111111111111111110000000000000000000000111111111100000011111"
    told = tell_contingency([int(one) for one in m], [one == "1" for one in y], response)
    assert told.verdict == CANNOT_TELL
    assert 7.0 < told.log_odds.max() < np.log(ODDS)


def test_an_own_arm_that_shows_where_it_is_not_expected_is_nobody():
    rates = np.array([[0.003, 0.5, 0.279], [0.325, 0.5, 0.833], [0.964, 0.977, 0.995]])
    # A simulated robot, as it came: its arm shows for half a second in cells beyond its own. As ten
    # pictures that do not know of each other these were told as somebody.
    m = "222122222222222210000022100000221000222220022222222222222212"
    m += "210002212200000000000000000021021000000002210222221022002222"
    y = "000000000000000000000000000000000000000000000000000001100000"
    y += "000000000000000000000000000001000000000000110001111101000010"
    moved, image = [int(one) for one in m], [one == "1" for one in y]
    apart = MotionResponse(PERIOD, 1, rates, 0.009, 0.009, 0.149, 0.786)
    odds = tell_contingency(moved, image, apart).log_odds
    assert odds[-1] > -4.0
    told = tell_contingency(moved, image, replace(apart, lingers=0.3))
    assert told.verdict == NOBODY
    assert told.settled


def test_who_is_hidden_a_quarter_of_the_time_is_not_taken_for_another():
    found = [met("self, hidden now and then", seed).verdict for seed in range(100)]
    assert NOT_ME not in found
    assert found.count(SELF) > 95


def test_nobody_is_told_from_somebody_where_there_is_time():
    found = [met("nobody", seed, 300).verdict for seed in range(20)]
    assert found.count(NOBODY) > 15


def test_who_does_not_move_cannot_tell():
    still, image = np.full(200, STILL), np.zeros(200, dtype=bool)
    found = tell_contingency(still, image, RESPONSE)
    assert found.verdict == CANNOT_TELL
    assert not found.settled
    assert found.seconds == pytest.approx(10.0)


def test_before_the_first_picture_nothing_is_said():
    found = tell_contingency([], [], RESPONSE)
    assert found.verdict == CANNOT_TELL
    assert found.seconds == 0.0


def test_what_was_found_cannot_be_changed():
    found = met("self", 0)
    with pytest.raises(ValueError, match="read-only"):
        found.log_odds[0] = 1.0
    with pytest.raises(ValueError, match="read-only"):
        RESPONSE.seen[0, 0] = 1.0


def test_motion_that_tells_no_delay_is_refused():
    rng = np.random.default_rng(3)
    own, image = motion(200, rng), motion(200, rng)
    with pytest.raises(NotIdentifiableError, match="no certain delay"):
        learn_response(MUCH * own, image, np.zeros(200), PERIOD)
    with pytest.raises(NotIdentifiableError, match="move for longer"):
        learn_response([1, 0], [1, 0], [0, 0], PERIOD)


def test_series_of_different_lengths_are_refused():
    with pytest.raises(ValueError, match=r"one shape \(T,\)"):
        tell_contingency([1, 0], [1], RESPONSE)


def test_motion_that_is_neither_little_nor_much_is_refused():
    with pytest.raises(ValueError, match="moved must be 0 to 2, got 0 to 3"):
        tell_contingency([0, 3], [0, 1], RESPONSE)
