"""A joint of a body that is read in another unit than stated is named, by learning it mended."""

from dataclasses import replace

import numpy as np
import pytest

from nico_selfmodel.errors import DataError
from nico_selfmodel.estimation.tree.tree_calibration import calibrate_tree

from .simulated_trees import observed, one_arm


def read_in(data, stated, mistaken):
    """The recording with all joints stated in one unit, and some read in the other."""
    readings = data.readings.copy()
    for i in range(len(data.joints)):
        if (stated == "deg") != (i in mistaken):
            readings[:, i] = np.degrees(readings[:, i])
    joints = tuple(replace(joint, encoder_unit=stated) for joint in data.joints)
    return replace(data, readings=readings, joints=joints)


@pytest.mark.parametrize(
    ("stated", "read", "mistaken"),
    [
        ("rad", "deg", {1}),
        pytest.param("deg", "rad", {2}, marks=pytest.mark.slow),
        pytest.param("deg", "rad", {0, 3}, marks=pytest.mark.slow),
    ],
)
def test_joints_in_another_unit_are_named_and_no_others(stated, read, mistaken):
    data = one_arm(11, joints=4, markers=2, poses=40).data
    with pytest.raises(DataError) as raised:
        calibrate_tree(read_in(data, stated, mistaken), effects=())
    names = ", ".join(f"j{i + 1}" for i in sorted(mistaken))
    verb = "is" if len(mistaken) == 1 else "are"
    assert str(raised.value).startswith(f"{names} {verb} read in {read}, not in {stated}")


@pytest.mark.slow
def test_a_joint_that_really_turned_little_is_believed():
    sim = one_arm(12, joints=4, markers=2, poses=40)
    q = sim.readings_true * [1.0, 0.02, 1.0, 1.0]
    rng, how = np.random.default_rng(12), {"joint_sigma": 2e-4, "sigma": {"points": 2e-4}}
    data = sim.data
    still = observed(sim.tree, data.joints, data.markers, data.sensors, q, rng, **how)
    found = calibrate_tree(read_in(still, "deg", set()), effects=())
    assert 1e3 * np.median(found.train.by_row()) < 1.0
