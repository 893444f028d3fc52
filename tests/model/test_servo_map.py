"""Encoder readings <-> joint displacements."""

import dataclasses

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from nico_selfmodel.model.arm.servo_map import ServoMap

JOINTS = ("counted", "radian", "degree")


@pytest.fixture
def servos():
    return ServoMap(
        JOINTS,
        offset=[0.1, 0.2, -0.3],
        gear=[2.0, 1.0, 0.5],
        unit=("counts", "rad", "deg"),
        counts_per_turn=[4096.0, np.nan, np.nan],
        sign=[1.0, -1.0, 1.0],
    )


def test_every_unit_becomes_radians_with_its_sign(servos):
    assert servos.to_radians([1024.0, 0.5, 90.0]) == pytest.approx([np.pi / 2, -0.5, np.pi / 2])
    assert servos.radians_per_unit == pytest.approx([2 * np.pi / 4096, -1.0, np.pi / 180])


def test_a_reading_is_offset_plus_gear_times_the_joint(servos):
    assert servos.to_joint(servos.to_encoder(np.zeros(3))) == pytest.approx(np.zeros(3), abs=1e-15)
    assert servos.to_encoder(np.zeros(3)) == pytest.approx(
        [0.1 * 4096 / (2 * np.pi), -0.2, np.degrees(-0.3)]
    )
    assert servos.to_joint([0.1 * 4096 / (2 * np.pi) + 2048, -0.2 - 1.0, np.degrees(-0.3) + 90])[
        [0, 1, 2]
    ] == pytest.approx([np.pi / 2, 1.0, np.pi])


@given(seed=st.integers(0, 2**32 - 1), count=st.integers(1, 7))
def test_readings_come_back_from_joint_angles(make_servos, seed, count):
    servos = make_servos(tuple("abcdefg"[:count]), seed)
    q = np.random.default_rng(seed).uniform(-np.pi, np.pi, (6, count))
    readings = servos.to_encoder(q)
    assert readings.shape == (6, count)
    assert servos.to_joint(readings) == pytest.approx(q, abs=1e-12)
    assert servos.to_encoder(servos.to_joint(readings)) == pytest.approx(readings, rel=1e-12)


def test_a_servo_map_cannot_be_changed(servos):
    for name in ("offset", "gear", "sign", "counts_per_turn"):
        with pytest.raises(ValueError, match="read-only"):
            getattr(servos, name)[0] = 1.0


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"gear": [1.0, 0.0, 1.0]}, "gear must not be zero"),
        ({"gear": [1.0, np.nan, 1.0]}, "gear must be finite"),
        ({"sign": [1.0, 0.5, 1.0]}, "sign"),
        ({"offset": [0.0, 0.0]}, r"offset must have shape \(3,\), got \(2,\)"),
        ({"unit": ("counts", "rad", "turns")}, "turns"),
        ({"unit": ("rad", "rad")}, "unit must name"),
        ({"unit": "rad"}, "unit must name"),
        ({"counts_per_turn": [np.nan] * 3}, "counts_per_turn must be positive"),
        ({"counts_per_turn": [0.0, np.nan, np.nan]}, "counts_per_turn must be positive"),
        ({"counts_per_turn": [4096.0]}, "counts_per_turn"),
    ],
)
def test_a_servo_map_that_is_none_is_refused(servos, change, message):
    with pytest.raises(ValueError, match=message):
        dataclasses.replace(servos, **change)
