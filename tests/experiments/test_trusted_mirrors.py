"""Mirrors are trusted by what the unmarked body shows, before that is learned from them."""

from contextlib import nullcontext
from types import SimpleNamespace

import numpy as np
import pytest

from nico_selfmodel.errors import EstimationError
from nico_selfmodel.sessions.looks.expecting import Unknown
from nico_selfmodel.sessions.mirrors import knowing
from nico_selfmodel.sessions.mirrors.knowing import TRUSTED, know_itself, trusting

LEARNED = Unknown(color=0.5)


class StainedLooks:
    """What looks say of a glass with stains: unlike a description, like what was learned in it."""

    share = 0.0

    def __init__(self, *_):
        self.unknown = LEARNED

    def before(self, *_):
        pass

    def before_known(self, name, known, unknown, X_BM):
        self.unknown = unknown

    def shot(self, *_):
        return None

    def unlike(self, commands, links):
        return 0.0 if self.unknown is LEARNED else self.share

    def unknown_of(self, commands):
        self.unknown = LEARNED
        return LEARNED


@pytest.fixture
def robot(monkeypatch):
    view = SimpleNamespace(X_BM=np.eye(4))
    before = SimpleNamespace(
        station=lambda _: nullcontext(), views=dict.fromkeys(("mirror", "turned"), view)
    )
    nico = SimpleNamespace(arm=None, workspace=None)
    body = SimpleNamespace(mirror=lambda _: None)
    for name, value in {
        "rendered": lambda *_: nico,
        "NicoBeforeMirrors": lambda *_, **__: before,
        "BodyImage": lambda *_: nullcontext(),
        "MirrorLooks": StainedLooks,
        "look_poses": lambda *_: np.zeros((5, 2)),
        "know_body": lambda *_: body,
    }.items():
        monkeypatch.setattr(knowing, name, value)
    return SimpleNamespace(seed=1, model=SimpleNamespace(mirrors={"mirror": None, "turned": None}))


@pytest.mark.parametrize(("share", "trusted"), [(0.0029, True), (0.0031, False)])
def test_stains_are_told_before_they_are_learned_as_colours(robot, monkeypatch, share, trusted):
    assert TRUSTED == 0.003
    monkeypatch.setattr(StainedLooks, "share", share)
    known = know_itself(robot, knowing.PLATE, lambda *_: None)
    assert dict(known.unlike) == {"mirror": share, "turned": share}
    assert dict(known.unknown) == {"mirror": LEARNED, "turned": LEARNED}
    if trusted:
        assert trusting(known) is known
        return
    with pytest.raises(EstimationError, match=r"0\.3 % of the unmarked head and chest"):
        trusting(known)
