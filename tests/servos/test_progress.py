"""When a joint counts as blocked: how far it may stay behind, for how long, and how late it is."""

import math

import numpy as np
import pytest

from nico_selfmodel.servos.arm.jam_watch import JamWatch

DEGREE = 1000.0
PERIOD = 0.02


def watched(commanded, position, *, speed=10.0, period=PERIOD):
    """Show a joint's way; return when it was blamed [s], None if it never was.

    Args:
        commanded: Where its board commands it to be at each reading [deg].
        position: Where it is [deg].
        speed: Of the motion [deg/s].
        period: Time between readings [s].
    """
    jams = JamWatch(DEGREE * 180.0 / math.pi)
    for k, (c, p) in enumerate(zip(commanded, position, strict=True)):
        place = round(DEGREE * c), round(DEGREE * p)
        if jams.note(k * period, *place, speed * DEGREE) is not None:
            return k * period
    return None


def ramp(seconds, speed=10.0, period=PERIOD, still=1.5):
    """Return a way at constant speed [deg], with some standing before and after."""
    times = np.arange(0.0, 1.5 + seconds + still, period)
    return np.clip(times - 1.5, 0.0, seconds) * speed


@pytest.mark.parametrize(("left", "blamed"), [(0.27, False), (0.35, True)])
def test_a_joint_that_moved_may_stop_a_little_before_its_goal(left, blamed):
    way = ramp(2.0)
    assert (watched(way, np.minimum(way, 20.0 - left)) is not None) == blamed


@pytest.mark.parametrize(("friction", "blamed"), [(0.36, False), (0.39, True)])
def test_where_a_joint_turns_round_friction_may_hold_it_farther(friction, blamed):
    there = ramp(0.5)
    goal = 2.0 * friction + 0.02
    way = np.concatenate([there, there[-1] - np.clip(ramp(0.5), 0.0, goal)])
    place = [0.0]
    for c in way[1:]:
        place.append(min(max(place[-1], c - friction), c + friction))
    assert (watched(way, place) is not None) == blamed


@pytest.mark.parametrize(("seconds", "blamed"), [(0.6, False), (0.85, True)])
def test_a_joint_may_stay_behind_for_a_while(seconds, blamed):
    way = ramp(3.0)
    held = round((1.5 + 1.0) / PERIOD)
    place = way.copy()
    place[held : held + round(seconds / PERIOD)] = way[held]
    assert (watched(way, place) is not None) == blamed


@pytest.mark.parametrize(("share", "blamed"), [(0.55, False), (0.45, True)])
def test_a_joint_must_go_half_of_its_way(share, blamed):
    way = ramp(2.0, still=0.0)
    assert (watched(way, share * way) is not None) == blamed


@pytest.mark.parametrize("speed", [2.0, 5.0, 20.0, 60.0])
@pytest.mark.parametrize("period", [0.012, 0.05, 0.14])
def test_a_joint_that_jams_is_blamed_within_a_second(speed, period):
    way = ramp(2.0, speed, period)
    jam = round(2.5 / period)
    place = np.minimum(way, way[jam])
    when = watched(way, place, speed=speed, period=period)
    assert 0.6 < when - 2.5 < 1.0 + 2 * period


def test_slow_motions_are_watched_for_longer():
    way = ramp(40.0, 0.1)
    assert 3.0 + 7.0 < watched(way, np.zeros_like(way), speed=0.1) - 1.5 < 3.0 + 8.0 + 4.0


def test_a_load_that_pulls_a_standing_joint_away_is_not_a_jam():
    way = np.concatenate([ramp(1.0), np.full(200, 10.0), 10.0 + ramp(0.05)])
    place = way.copy()
    place[len(ramp(1.0)) + 50 :] -= 1.2
    assert watched(way, place) is None


@pytest.mark.parametrize("lag", [0.05, 0.1, 0.3])
@pytest.mark.parametrize("back", [False, True])
def test_a_lag_is_not_a_jam(lag, back):
    way = ramp(1.5, 30.0)
    if back:
        way = np.concatenate([way, way[-1] - ramp(0.3, 30.0)])
    place = [0.0]
    for c in way[1:]:
        place.append(place[-1] + (1.0 - math.exp(-PERIOD / lag)) * (c - place[-1]))
    assert watched(way, place, speed=30.0) is None


@pytest.mark.parametrize("back", [0.5, 0.7, 1.0, 2.0])
def test_a_joint_that_lags_and_rubs_may_be_turned_round_on_the_way(back):
    """It never gets to where its command turned: what it has to go back is less."""
    there = ramp(0.5, 60.0, still=0.0)
    way = np.concatenate([there, there[-1] - np.clip(ramp(1.0, 5.0)[75:], 0.0, back)])
    place = [0.0]
    for c in way[1:]:
        pulled = min(max(place[-1], c + 0.3 - 0.25), c + 0.3 + 0.25)  # a load, too
        place.append(place[-1] + (1.0 - math.exp(-PERIOD / 0.05)) * (pulled - place[-1]))
    assert watched(way, place, speed=60.0) is None


def test_a_host_that_slept_does_not_count_as_a_joint_that_stayed_behind():
    jams = JamWatch(DEGREE * 180.0 / math.pi)
    assert jams.note(0.0, 0, 0, DEGREE) is None
    assert jams.note(0.1, 3000, 1000, DEGREE) is None
    assert jams.note(60.0, 3000, 1000, DEGREE) is None  # and now it catches up
    assert jams.note(60.1, 3000, 3000, DEGREE) is None
    assert not jams.behind


def test_a_motion_may_end_half_a_second_late():
    jams = JamWatch(DEGREE)
    assert jams.overdue(1e9) is None
    jams.expect(10.0, 2.0)
    assert jams.overdue(12.5) is None
    assert "over 0.5 s ago" in jams.overdue(12.6)
    jams.delay(1.0)
    assert jams.overdue(13.5) is None
    jams.arrived()
    assert jams.overdue(1e9) is None
