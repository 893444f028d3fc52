"""Names of a body's markers that are exchanged in part of a recording are named as exchanged."""

from dataclasses import replace

import numpy as np
import pytest

from nico_selfmodel.estimation.judging import judge
from nico_selfmodel.estimation.tree.tree_calibration import calibrate_tree

from ..slow_rest import slow_rest
from .simulated_trees import two_arms

POSES = 60


def with_exchanged(data, share, seed):
    """Return a recording in a share of whose samples the first two markers are exchanged."""
    table, rng = data.observations, np.random.default_rng(seed)
    some = rng.choice(POSES, round(share * POSES), replace=False)
    mixed = np.isin(table.pose, some) & (table.marker < 2)
    told = np.where(mixed, 1 - table.marker, table.marker)
    return replace(data, observations=replace(table, marker=told))


def exchanged_words(data):
    return [w for w in judge(calibrate_tree(data, effects=())).warnings if "exchanged" in w]


@pytest.mark.parametrize("share", slow_rest([0.12, 0.3], plain=0))
def test_tags_exchanged_in_part_of_a_recording_are_named(share):
    made = two_arms(11, poses=POSES, tags_each=4)
    first, second = (marker.name for marker in made.data.markers[:2])
    (words,) = exchanged_words(with_exchanged(made.data, share, 11))
    count = round(share * POSES)
    assert words.startswith(f"markers {first} and {second} are exchanged in {count} of 59 samples")


@pytest.mark.slow
def test_no_tags_of_a_sound_recording_are_exchanged():
    assert not exchanged_words(two_arms(11, poses=POSES, tags_each=4).data)
