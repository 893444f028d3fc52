"""Time of asking an arm what bends: processor time of the ladder, and of sag alone."""

import time

import numpy as np
import pytest

from nico_selfmodel.estimation.arm import kinematics
from nico_selfmodel.estimation.bending.steps import STEPS
from tests.estimation.sagging_arms import SaggingArm

pytestmark = pytest.mark.benchmark
POSES = 333
"""With one marker about 1,000 rows of equations."""


def seconds_of(monkeypatch, effects, **weak):
    """Processor time of the rigid refinement and of the ladder, the best of three."""
    rng, spent = np.random.default_rng((0, 91)), {}
    train, _ = SaggingArm.drawn(rng, **weak).recorded(rng, POSES)
    for name in ("_refined", "climb"):
        asked = getattr(kinematics, name)

        def timed(*args, name=name, asked=asked):
            began = time.process_time()
            found = asked(*args)
            spent.setdefault(name, []).append(time.process_time() - began)
            return found

        monkeypatch.setattr(kinematics, name, timed)
    for _ in range(3):
        kinematics.calibrate_kinematics(train, explain=False, effects=effects)
    return min(spent["_refined"]), min(spent["climb"])


def test_the_ladder_takes_at_most_three_seconds(monkeypatch):
    _, ladder = seconds_of(monkeypatch, STEPS, bearing=1.0, ripple=1.0, gear=1.0)
    print(f"{ladder:.2f} s for {3 * POSES} rows")
    assert ladder <= 3.0


def test_sag_alone_takes_at_most_twice_the_rigid_refinement(monkeypatch):
    rigid, sag = seconds_of(monkeypatch, ("sag",))
    print(f"{sag / rigid:.2f} times the rigid refinement")
    assert sag <= 2.0 * rigid
