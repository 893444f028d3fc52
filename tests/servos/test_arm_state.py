"""What is known of an arm at one moment, as whoever copies it often gets it."""

import numpy as np
import pytest

from nico_selfmodel.servos.arm_state import ArmState


def state(valid):
    return ArmState(
        time=3.0,
        joints=("shoulder", "elbow"),
        q=np.array([0.1, 0.2]),
        readings=np.array([100.0, 200.0]),
        age=np.array([0.01, 0.4]),
        valid=np.array(valid),
        moving=np.array([False, True]),
        enabled=np.array([True, True]),
        zero_known=np.array([True, True]),
        trouble=(None, "over-current"),
    )


@pytest.mark.parametrize("valid", [[True, False], [1, 0]], ids=["booleans", "numbers"])
def test_in_the_rows_a_joint_that_is_not_valid_is_nowhere_and_the_others_stay(valid):
    rows = dict(zip(ArmState.ROWS, state(valid).rows, strict=True))
    np.testing.assert_array_equal(rows["q"], [0.1, np.nan])
    np.testing.assert_array_equal(rows["readings"], [100.0, np.nan])
    np.testing.assert_array_equal(rows["valid"], [1.0, 0.0])
    np.testing.assert_array_equal(rows["age"], [0.01, 0.4])
    np.testing.assert_array_equal(rows["moving"], [0.0, 1.0])


def test_a_state_keeps_the_last_reading_and_cannot_be_changed():
    known = state([True, False])
    assert known.readings[1] == 200.0
    assert known.oldest == 0.4
    for name in (*ArmState.ROWS, "rows"):
        with pytest.raises(ValueError, match="read-only"):
            getattr(known, name)[...] = 0
