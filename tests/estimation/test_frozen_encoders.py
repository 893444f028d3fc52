"""An encoder that stood for a while is the cause of what contradicts the rest there."""

from dataclasses import replace

import numpy as np
import pytest

from nico_selfmodel.estimation.judging import judge
from nico_selfmodel.estimation.tree.contradictions.standing_still import frozen_reading
from nico_selfmodel.estimation.tree.tree_calibration import calibrate_tree

from ..slow_rest import slow_rest
from .simulated_trees import one_arm

FIRST, LAST = 25, 38


def frozen(data, joint):
    """Return a recording in which one encoder was not read for fourteen samples."""
    readings = np.array(data.readings)
    readings[FIRST : LAST + 1, joint] = readings[FIRST, joint]
    return replace(data, readings=readings)


@pytest.mark.parametrize("joint", slow_rest([5, 4, 3], plain=1))
def test_a_body_whose_encoder_stood_is_no_body_of_wrong_labels(joint):
    for seed in range(2):
        sim = one_arm(seed, joints=6, markers=3, poses=50, joint_sigma=np.radians(0.03))
        assert judge(calibrate_tree(sim.data, effects=())).status == "NOT_EVALUATED"
        verdict = judge(calibrate_tree(frozen(sim.data, joint), effects=()))
        assert verdict.status == "FAIL"
        assert f"the encoder of 'j{joint + 1}' stands at" in verdict.reasons[0]
        assert f"from sample {FIRST} to {LAST} while others move" in verdict.reasons[0]


@pytest.mark.parametrize(
    ("inside", "outside", "told"),
    [(3, 0, True), (2, 0, False), (4, 1, True), (4, 2, False), (14, 13, True), (14, 14, False)],
)
def test_what_was_set_aside_lies_where_it_stood_far_more_often_than_by_chance(
    inside, outside, told
):
    """Of 50 samples 14 have three of three by chance once in 54, four of six in 23."""
    data = frozen(one_arm(0, joints=6, poses=50).data, 5)
    aside = np.zeros(50, dtype=bool)
    aside[FIRST : FIRST + inside] = aside[:outside] = True
    said = frozen_reading(data, aside)
    assert (f"of {inside + outside} samples that contradict the rest {inside}" in said) == told


def test_nothing_is_said_where_no_joint_stood():
    data = one_arm(0, joints=6, poses=50).data
    assert frozen_reading(data, np.arange(50) % 2 == 0) == ""
