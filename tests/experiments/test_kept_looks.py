"""Looks are large: the mirror test keeps one of a kind for its report, and lets the others go."""

import gc
import weakref
from contextlib import nullcontext
from types import SimpleNamespace
from typing import ClassVar

import numpy as np
import pytest

from nico_selfmodel.experiments.mirror_test import marks, unmarked
from nico_selfmodel.experiments.mirror_test.marks import MarkTrial, Watched, run_marks
from nico_selfmodel.experiments.mirror_test.painting import MARK
from nico_selfmodel.experiments.mirror_test.unmarked import Look, run_unmarked
from nico_selfmodel.sessions.mirrors.mirror_scenario import MIRROR


class Looks:
    """A pair of looks, as large as may be, and how many of all that were taken are kept."""

    taken: ClassVar[list[weakref.ref]] = []
    most = 0

    def __init__(self):
        gc.collect()
        Looks.taken.append(weakref.ref(self))
        Looks.most = max(Looks.most, sum(one() is not None for one in Looks.taken))


@pytest.fixture
def little_to_collect():
    """Let what was there before be no concern of the collector, which is asked at each look."""
    gc.freeze()
    yield
    gc.unfreeze()


@pytest.fixture
def known(monkeypatch, little_to_collect):
    Looks.taken, Looks.most = [], 0
    body = SimpleNamespace(mirror=lambda _: None, pose=lambda _: None)
    plate = SimpleNamespace(plate=None, station=lambda _: nullcontext())
    for room in (marks, unmarked):
        monkeypatch.setattr(
            room, "rendered", lambda *_: SimpleNamespace(arm=None, quality=None), raising=True
        )
        image = nullcontext(SimpleNamespace(links={}, moving=()))
        monkeypatch.setattr(room, "BodyImage", lambda *_, image=image: image)
    monkeypatch.setattr(marks, "NicoStation", lambda *_, **__: nullcontext())
    before = SimpleNamespace(station=plate.station, views={MIRROR: SimpleNamespace(X_BM=np.eye(4))})
    monkeypatch.setattr(unmarked, "NicoBeforeMirrors", lambda *_, **__: before)
    poses = {MIRROR: np.zeros((5, 2))}
    robot = SimpleNamespace(seed=1, world=None, model=None)
    return SimpleNamespace(
        robot=robot, body=body, before=plate, poses=poses, unknown={MIRROR: None}
    )


def test_of_many_trials_with_marks_the_first_look_at_one_is_kept(known, monkeypatch):
    def trial(self, kind, remove, rng):
        return MarkTrial(1, SimpleNamespace(kind=kind), (), None), Looks()

    monkeypatch.setattr(marks._Session, "__init__", lambda *_: None)
    monkeypatch.setattr(marks._Session, "trial", trial)
    monkeypatch.setattr(marks, "watched", lambda robot, _: Watched(robot.seed, 9, None))
    found = run_marks([known], 16)
    assert found.watched == (Watched(known.robot.seed, 9, None),)
    assert len(found.trials) == len(Looks.taken) == 16
    assert found.shown is not None
    assert found.shown[0].kind == MARK
    assert Looks.most <= 3  # that one, the last, and the one that is made


def test_of_many_unmarked_looks_one_is_kept(known, monkeypatch):
    session = SimpleNamespace(look=lambda _: Looks(), before_known=lambda *_: None)
    monkeypatch.setattr(unmarked, "_paints", lambda _: None)
    monkeypatch.setattr(unmarked, "MirrorLooks", lambda *_, **__: session)
    monkeypatch.setattr(
        unmarked, "_counted", lambda robot, light, *_: Look(robot, light, (1, 1), (1, 1), (3, 3), 0)
    )
    found = run_unmarked([known], 15)
    assert len(found.looks) == len(Looks.taken) == 15
    assert isinstance(found.shown, Looks)
    assert Looks.most <= 3
