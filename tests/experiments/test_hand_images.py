"""How long a robot looks for images of its own hand."""

from types import SimpleNamespace

import numpy as np
import pytest

from nico_selfmodel.sessions.mirrors import hand_images
from nico_selfmodel.vision.images.not_seen import NotSeen

POSES = [np.array([float(k)]) for k in range(100)]


def watch(monkeypatch, seen):
    """Look for twelve images where those of some poses are seen; return how many poses it took."""
    visited = []
    nothing = NotSeen("hidden")

    def find(picture, own):
        return (np.array([400.0, 300.0]) if visited[-1] in seen else nothing), nothing

    body = SimpleNamespace(context=None, relive=lambda command: visited.append(int(command[0])))
    monkeypatch.setattr(hand_images, "StationBody", lambda *rest: body)
    monkeypatch.setattr(hand_images, "put_mirror", lambda *rest: None)
    monkeypatch.setattr(
        hand_images, "fiducials_in_mirror", lambda *a, **k: {"fiducial": [find] * 2}
    )
    monkeypatch.setattr(hand_images, "HandImages", lambda *parts: len(parts[3]))
    station = SimpleNamespace(
        joints=("one",),
        tracked=(),
        stand_other=lambda *rest: None,
        GetInputPort=lambda name: SimpleNamespace(FixValue=lambda *rest: None),
        GetOutputPort=lambda name: SimpleNamespace(Eval=lambda context: POSES[visited[-1]]),
        picture=lambda *rest: None,
    )
    model = SimpleNamespace(
        rig=SimpleNamespace(project=lambda p: np.zeros(4)),
        points=lambda q: np.zeros((1, 3)),
        servos=SimpleNamespace(to_joint=lambda readings: readings),
    )
    return hand_images.watch_images(station, model, POSES, 12), len(visited)


@pytest.mark.parametrize(
    ("every", "images", "poses"), [(1, 12, 12), (3, 10, 30), (5, 6, 30), (10, 5, 41), (40, 3, 100)]
)
def test_who_sees_its_hand_seldom_goes_on_until_it_can_tell(monkeypatch, every, images, poses):
    assert watch(monkeypatch, set(range(0, 100, every))) == (images, poses)
