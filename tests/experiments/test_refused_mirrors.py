"""Robots that doubt what they see in a mirror: who looks again, and who goes on without them."""

from types import SimpleNamespace

import numpy as np
import pytest

from nico_selfmodel.errors import EstimationError
from nico_selfmodel.experiments.mirror_test import stages as the_stages
from nico_selfmodel.experiments.mirror_test.structure import StructureStage
from nico_selfmodel.experiments.mirror_test.unknown_mirror import WHOLE, MirrorPlace, MirrorsStage
from nico_selfmodel.sessions.mirrors import knowing
from nico_selfmodel.sessions.mirrors.knowing import Refusal


def placed_at(distance=1e-4):
    """Return a mirror that is so far from where a robot says it stands."""
    return MirrorPlace(WHOLE, np.radians(0.05), distance, 3.0)


@pytest.mark.parametrize(
    ("known", "off", "goes_on"),
    [((1, 2), {}, True), ((), {}, False), ((1, 2), {"distance": 0.6e-3}, False)],
)
def test_robots_that_trust_their_mirrors_go_on_where_another_refuses_one(
    monkeypatch, known, off, goes_on
):
    """A mirror that is not where they say ends the test for all."""
    refused, asked = (Refusal(7, "mirror 'turned' shows 40 % otherwise"),), []
    monkeypatch.setattr(the_stages, "images_document", lambda _: {"status": "PASS"})
    monkeypatch.setattr(the_stages, "encounters_document", lambda _: {"status": "PASS"})
    monkeypatch.setattr(the_stages, "run_images", lambda *_: None)
    monkeypatch.setattr(the_stages, "run_turning", lambda *_: None)
    monkeypatch.setattr(the_stages, "know_mirrors", lambda *_: (known, refused))
    placed = MirrorsStage(tuple(placed_at(**off) for _ in known), refused)
    monkeypatch.setattr(the_stages, "place_mirrors", lambda *_: placed)
    monkeypatch.setattr(the_stages, "run_structure", lambda *_: StructureStage((), 0))
    monkeypatch.setattr(the_stages, "run_unmarked", lambda robots, *_: asked.append(robots))
    monkeypatch.setattr(the_stages, "unmarked_document", lambda _: {"status": "FAIL"})
    the_stages._go_on({"encounters": None}, [1, 2, 7], 1, 8, None, None, False)
    assert asked == ([known] if goes_on else [])


@pytest.mark.parametrize(
    ("first", "second", "believed"),
    [("PASS", "FAIL", "first"), ("FAIL", "PASS", "second"), ("FAIL", "FAIL", None)],
)
def test_a_robot_that_doubts_a_mirror_looks_again_in_other_poses(
    monkeypatch, first, second, believed
):
    days = []

    def learn(*_, day, **__):
        days.append(day)
        word, status = [("first", first), ("second", second)][len(days) - 1]
        verdict = SimpleNamespace(status=status, reasons=(f"{word} is no plane",))
        return SimpleNamespace(verdict=verdict, word=word)

    monkeypatch.setattr(knowing, "learn_mirror", learn)
    monkeypatch.setattr(knowing, "rendered", lambda _: SimpleNamespace(arm=None))
    robot = SimpleNamespace(model=None, world=None, seed=7, readings=None)
    if believed is None:
        with pytest.raises(EstimationError, match="second is no plane"):
            knowing.learn_two_mirrors(robot, None, None)
    else:
        assert knowing.learn_two_mirrors(robot, None, None).word == believed
    assert len(set(days)) == len(days) == (1 if believed == "first" else 2)
