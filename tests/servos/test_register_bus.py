"""The one owner of a port of servos: late replies, echoes, noise, what is lost and what is not."""

from contextlib import suppress

import pytest

from nico_selfmodel.errors import BusError, ServoFault
from nico_selfmodel.servos.bus_settings import BusSettings, NoReplyError
from nico_selfmodel.servos.register_servo.sdk_port import SdkPort

from .arms import MAKES, virtual_arm


@pytest.fixture(params=MAKES[1:])
def made(request):
    arm = virtual_arm(make=request.param)
    arm.arm.connect()
    return arm


def position(made, address):
    motor = made.arm.bus.motors[address - 1]
    return motor.number(made.bus.read(address, *motor.position).data)


@pytest.mark.parametrize("late", [0.01, 0.04, 0.1, 0.3])
@pytest.mark.parametrize("shared", [False, True])
def test_a_late_reply_is_never_taken_for_a_later_one(made, late, shared):
    """A servo that was read with the others and answers late has moved on since."""
    motor = made.arm.bus.motors[0]
    made.modules[0].late_by = late
    if shared:
        found = made.bus.sync_read(*motor.block, [1])
    else:
        found = {}
        with suppress(NoReplyError):  # where it is not that late it is in time
            made.bus.read(1, *motor.block, attempts=1)
    made.modules[0].shaft += 500.0
    status = made.bus.read(1, *motor.block)
    if not found:
        assert motor.decode(status).position == 2548
    assert position(made, 2) == 2048
    made.modules[0].shaft += 500.0
    assert position(made, 1) == 3048


def test_a_servo_that_stays_silent_is_named_in_time(made):
    made.modules[1].silent = True
    begin = made.port.now()
    with pytest.raises(NoReplyError, match="servo 2 does not answer"):
        position(made, 2)
    assert made.port.now() - begin < 0.6
    assert made.bus.counts[2].failures == 1
    assert position(made, 3) == 2048


def test_garbage_before_a_packet_is_thrown_away(made):
    made.port._buffer += b"\xff\xff\xfd\x00\x01\x02\xff"
    assert position(made, 3) == 2048


def test_a_line_that_never_gets_quiet_is_given_up(made):
    made.bus._doubtful = True
    made.port.read = lambda count, timeout: b"\x00" * count
    original, ticks = made.port.now, iter(range(100_000))
    made.port.now = lambda: original() + 1e-3 * next(ticks)
    with pytest.raises(BusError, match="never gets quiet"):
        position(made, 1)


def test_an_adapter_that_echoes_is_called_one_or_does_no_harm(made):
    original = made.port.write

    def echo(data):
        made.port._buffer += data
        original(data)

    made.port.write = echo
    if made.arm.config.make.name == "feetech":
        with pytest.raises(BusError, match="the adapter echoes"):
            position(made, 1)
    else:
        assert position(made, 1) == 2048


def test_a_refused_packet_is_a_fault_that_says_why():
    made = virtual_arm(make="dynamixel")
    made.arm.connect()
    made.arm.enable()
    with pytest.raises(ServoFault, match=r"servo 1 refuses .*: .* may not be written now"):
        made.bus.write(1, 10, b"\x00")


def test_patience_grows_with_each_failure_and_an_interrupted_exchange_leaves_the_port_free(made):
    port = SdkPort(made.port, BusSettings(slack=0.02, latency=1e-3))
    waits = []
    for attempt in range(5):
        port.attempt = attempt
        port.setPacketTimeout(10)
        waits.append(port._deadline - made.port.now())
    assert waits == sorted(waits)
    assert 0.02 < waits[0] < 0.03
    assert 0.16 < waits[4] < 0.17
    port.is_using = True
    assert not port.is_using
    assert port.getBaudRate() == 1_000_000
