"""A hundred thousand commands on a line that damages bytes: no wrong position, and no hang."""

import numpy as np
import pytest

from nico_selfmodel.errors import BusError, ServoFault
from nico_selfmodel.servos.bus_settings import BusSettings
from nico_selfmodel.servos.simulated.line import WireFaults

from ..slow_rest import slow_rest
from .arms import JOINTS, MAKES, virtual_arm

SETTINGS = {
    "pic-servo": BusSettings(attempts=12),
    # Their packets are longer: of those that ask for a state, one in four comes through.
    "dynamixel": BusSettings(attempts=80, slack=1e-3),
    "feetech": BusSettings(attempts=80, slack=1e-3),
}


def listen(made):
    """Return for each motor the positions that it has said since that was last asked."""
    said = [set() for _ in made.modules]
    for module, positions in zip(made.modules, said, strict=True):
        name = "reply" if hasattr(module, "reply") else "read"
        original = getattr(module, name)

        def speak(*a, module=module, positions=positions, original=original, **k):
            positions.add(module.position)
            return original(*a, **k)

        setattr(module, name, speak)
    return said


def soak(make, seed, commands):
    """Move an arm about on a bad line; return what there is to say of it."""
    made = virtual_arm(make=make, settings=SETTINGS[make], heartbeat=1.0)
    made.arm.connect()
    made.arm.enable()
    rng = np.random.default_rng(seed)
    made.line.faults = WireFaults(rng, corrupt=0.01, drop=0.01, duplicate=0.001)
    said = listen(made)
    moves = recovered = 0
    before = made.bus.total().exchanges
    while made.bus.total().exchanges - before < commands:
        begin = made.port.time
        try:
            made.arm.heartbeat()
            if not made.arm.moving:
                moves += 1
                chosen = rng.choice(JOINTS, 3, replace=False)
                made.arm.move({name: float(rng.uniform(-1.0, 1.0)) for name in chosen})
            state = made.arm.cycle()
        except (BusError, ServoFault):  # damage that a checksum does not show
            recovered += 1
            made.arm.connect()
            made.arm.enable()
            continue
        accepted = [axis.position for axis in made.arm.axes]
        wrong = [p for p, positions in zip(accepted, said, strict=True) if p not in positions]
        assert wrong == []
        assert state.valid.all()
        assert made.port.time - begin < 5.0  # no hang
        for axis, module in zip(made.arm.axes, made.modules, strict=True):
            since = made.port.time - axis.seen + 0.1
            way = 1.3 * axis.largest_velocity * since
            assert abs(axis.position - module.position) < axis.joint.still + 4 + way
        for positions, position in zip(said, accepted, strict=True):
            positions.intersection_update({position})
    return made, moves, recovered


@pytest.mark.slow
@pytest.mark.parametrize("make", MAKES)
def test_a_soak_on_a_bad_line_accepts_no_wrong_position_and_recovers(make):
    """100,000 commands; 1 % of the bytes corrupted, 1 % dropped, 0.1 % doubled, both ways."""
    made, moves, recovered = soak(make, 0, 100_000)
    total, faults = made.bus.total(), made.line.faults
    assert moves > 500
    assert recovered <= (20 if make == "pic-servo" else 3)
    assert total.exchanges >= 100_000
    assert min(total.timeouts, total.damaged, total.stray_bytes) > 1000
    assert min(faults.corrupted, faults.dropped, faults.duplicated) > 1000


@pytest.mark.slow
@pytest.mark.parametrize("make", slow_rest(MAKES))
def test_a_short_soak_of_each_make(make):
    _, moves, recovered = soak(make, 1, 1500)
    assert moves > 5
    assert recovered == 0
