"""Who paints marks takes only places where paint lies on the surface and is to be seen."""

from types import SimpleNamespace

import numpy as np
import pytest

from nico_selfmodel.errors import RobotError
from nico_selfmodel.experiments.mirror_test import marks, painting
from nico_selfmodel.experiments.mirror_test.painting import MARK, SHAM_PAINT, NoPlaceError, Painter
from nico_selfmodel.systems.rendering.mark_on_body import Mark

PLACES = np.array([[0.0, 0.0, 0.1], [0.0, 0.0, 0.2], [0.0, 0.0, 0.3]])
NOISE = 2.0


class Surface:
    """A white surface that looks along z."""

    @staticmethod
    def color(_):
        return np.ones(3)

    @staticmethod
    def normals(p):
        return np.tile([0.0, 0.0, 1.0], (len(p), 1))


class Station:
    """Whose first place is a crease, and where paint changes two pictures by as much as is said."""

    def __init__(self, changes):
        self.changes, self.marks, self.wiped = changes, [], 0
        mirror = SimpleNamespace(plane=None)
        self.ground_truth = SimpleNamespace(X_LB=np.eye(4), mirror=lambda _: mirror, rig=None)

    def surfaces_true(self, _):
        return {"head": (Surface(), np.eye(4)), "chest": (Surface(), np.eye(4))}

    def paint(self, _, mark):
        if mark.p_FM[2] == 0.1:
            raise RobotError("head has no surface there to paint on")
        self.marks.append(mark)

    def wipe(self, _):
        self.marks.clear()
        self.wiped += 1

    def picture(self, _, side):
        picture = np.full((8, 8, 3), 100, np.uint8)
        for mark in self.marks:
            picture[2:5, 2:5] += np.uint8(self.changes[round(10 * mark.p_FM[2])][side == "right"])
        return picture


@pytest.fixture
def seen(monkeypatch):
    """Let both cameras see three places of the head."""
    found = SimpleNamespace(links=("head",) * 3, p_FQ=PLACES)
    surface = SimpleNamespace(in_mirror=lambda *_, **__: found)
    monkeypatch.setattr(painting, "SeenSurface", lambda *_: surface)


def painter(station):
    context = SimpleNamespace(SetTime=lambda _: None, get_time=lambda: 0.0)
    return Painter(station, context, np.eye(4), NOISE)


@pytest.mark.parametrize(("about", "shown"), [(None, 9.0), (3.0, 9.0), (20.0, 0.0)])
def test_a_mark_that_is_seen_directly_must_be_seen_where_it_is_reflected(about, shown):
    station = Station({2: (9, 9)})
    one = painter(station)
    before = one._pictures()
    station.paint(None, Mark("head", PLACES[1], 0.01, np.ones(3)))
    at = None if about is None else np.full((2, 2), about)
    assert one._shown(before, at) == shown


def test_a_crease_and_a_dark_place_are_no_places_for_a_mark(seen):
    station = Station({2: (9, 1), 3: (9, 3)})
    painted = painter(station).paint(MARK, np.random.default_rng(0))
    assert painted.mark.p_FM[2] == 0.3
    assert [mark.p_FM[2] for mark in station.marks] == [0.3]
    assert station.wiped == 1


def test_paint_of_the_surfaces_own_colour_need_not_be_seen(seen):
    station = Station({2: (0, 0)})
    painted = painter(station).paint(SHAM_PAINT, np.random.default_rng(0))
    assert painted.mark.p_FM[2] == 0.2
    assert station.wiped == 0


def test_where_no_place_is_to_be_seen_it_is_said(seen):
    station = Station({2: (1, 1), 3: (0, 9)})
    with pytest.raises(RobotError, match="no place for a mark"):
        painter(station).paint(MARK, np.random.default_rng(0))
    assert station.marks == []


@pytest.mark.parametrize(("hidden", "tried"), [(0, 1), (3, 4), (9, 10)])
def test_where_a_posture_shows_no_place_another_is_taken(monkeypatch, hidden, tried):
    session, asked = session_that_hides(monkeypatch, hidden)
    commands, *rest = session._somewhere(MARK, np.random.default_rng(0))
    assert len(asked) == tried
    assert commands == asked[-1]
    assert rest == ["painted", (), "here"]


def test_ten_postures_without_a_place_are_said(monkeypatch):
    session, asked = session_that_hides(monkeypatch, 10)
    with pytest.raises(NoPlaceError, match="no place"):
        session._somewhere(MARK, np.random.default_rng(0))
    assert len(asked) == 10


def session_that_hides(monkeypatch, hidden):
    """A session whose first postures show no place to be painted, and what it was asked."""
    asked = []

    def painted(self, kind, commands, rng):
        asked.append(commands)
        if len(asked) <= hidden:
            raise NoPlaceError("no place for a mark")
        return "painted", (), "here"

    monkeypatch.setattr(marks._Session, "__init__", lambda *_: None)
    monkeypatch.setattr(marks._Session, "_command", lambda self, name, rng: rng.random())
    monkeypatch.setattr(marks._Session, "_painted", painted)
    return marks._Session(), asked
