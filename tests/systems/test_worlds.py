"""The documented worlds."""

import numpy as np
import pytest

from nico_selfmodel.systems.simulated.imperfections import (
    IMPERFECTIONS,
    Imperfections,
    imperfections_named,
)


def test_a_clean_world_has_only_what_is_to_be_learned():
    clean = imperfections_named("clean")
    for flaw in ("play", "sag", "wobble", "wobble_share", "marker_sigma", "dropout_share"):
        assert getattr(clean, flaw) == 0.0, flaw
    for unknown in ("link_sigma", "axis_sigma", "gear_sigma", "encoder_zero"):
        assert getattr(clean, unknown) > 0.0, unknown


def test_the_thesis_world_has_every_flaw():
    thesis = imperfections_named("thesis")
    for flaw in ("play", "sag", "wobble", "wobble_share", "marker_sigma", "dropout_share"):
        assert getattr(thesis, flaw) > 0.0, flaw
    assert thesis.counts_per_turn < imperfections_named("clean").counts_per_turn


def test_other_noise_makes_another_world_with_another_name():
    changed = IMPERFECTIONS["clean"].with_noise(play_deg=0.5, marker_mm=0.7)
    assert changed.play == pytest.approx(np.radians(0.5))
    assert changed.marker_sigma == pytest.approx(7e-4)
    assert changed.name == "clean, changed"
    assert IMPERFECTIONS["clean"].play == 0.0
    assert changed.gear_sigma == IMPERFECTIONS["clean"].gear_sigma


def test_the_same_noise_is_the_same_world():
    thesis = IMPERFECTIONS["thesis"]
    assert thesis.with_noise() is thesis
    assert thesis.with_noise(marker_mm=0.6, play_deg=0.6) == thesis
    assert isinstance(thesis, Imperfections)
