"""One owner of the port, whatever the line does."""

import threading

import numpy as np
import pytest

from nico_selfmodel.errors import BusError
from nico_selfmodel.servos.pic_servo.line.bus import (
    FLUSH,
    Bus,
    BusSettings,
    NoReplyError,
    UncertainError,
)
from nico_selfmodel.servos.pic_servo.line.chain import scan
from nico_selfmodel.servos.pic_servo.protocol.commands import (
    NoOperation,
    ReadStatus,
    ResetPosition,
    SetBaud,
)
from nico_selfmodel.servos.pic_servo.protocol.status import StatusItem
from nico_selfmodel.servos.pic_servo.simulated.line import PicServoLine
from nico_selfmodel.servos.pic_servo.simulated.module import SimulatedModule
from nico_selfmodel.servos.ports import PortLostError
from nico_selfmodel.servos.simulated.line import WireFaults
from nico_selfmodel.servos.simulated.port import SimulatedPort

POSITION = StatusItem.POSITION


class Wire(WireFaults):
    """Damages chosen bytes: the numbers count from when it was made, both ways together."""

    def __init__(self, changes):
        super().__init__(np.random.default_rng(0))
        self.changes, self.count = changes, -1

    def pass_on(self, byte):
        self.count += 1
        change = self.changes.get(self.count, byte)
        return change if isinstance(change, bytes) else bytes([change])


@pytest.fixture
def two():
    """Return a bus with two modules at different positions, and its line."""
    line = PicServoLine([SimulatedModule(), SimulatedModule()])
    bus = Bus(SimulatedPort(line))
    scan(bus, [1, 2])
    line.modules[0].shaft, line.modules[1].shaft = 111.0, 222.0
    bus.counts.clear()
    return bus, line


def position(bus, address):
    return bus.exchange(address, ReadStatus(POSITION), POSITION).position


def test_an_exchange_takes_the_time_of_its_bytes(two):
    bus, _ = two
    begin = bus.port.now()
    assert position(bus, 1) == 111
    # 5 bytes there, 6 back, and the module's tick.
    assert bus.port.now() - begin == pytest.approx(11 * 10 / 19200 + 0.51e-3, abs=1e-9)
    assert bus.counts[1].exchanges == 1


def test_a_damaged_reply_is_read_again(two):
    bus, line = two
    line.faults = Wire({7: 0x55})  # within the position of the reply
    assert position(bus, 1) == 111
    assert (bus.counts[1].damaged, bus.counts[1].exchanges) == (1, 1)


def test_a_damaged_command_is_not_carried_out_but_sent_again(two):
    bus, line = two
    line.faults = Wire({3: 0x55})
    assert bus.exchange(1, ResetPosition(2, 5), 0).flags
    assert bus.counts[1].refused == 1
    line.faults = None
    assert position(bus, 1) == 5


def test_a_half_heard_command_is_ended_by_zeros(two):
    bus, line = two
    line.faults = Wire({2: b""})  # the module waits for one byte more
    assert position(bus, 1) == 111
    assert bus.counts[1].timeouts == 1
    line.faults = None
    assert position(bus, 2) == 222


def test_a_command_that_must_not_be_repeated_is_not(two):
    bus, line = two
    executed = []
    original = line.modules[0].execute
    line.modules[0].execute = lambda command: executed.append(command) or original(command)
    line.faults = Wire({10: 0x99})  # the reply of a SetPosition of nine bytes
    with pytest.raises(UncertainError, match="may or may not"):
        bus.exchange(1, ResetPosition(2, 5), 0)
    assert len(executed) == 1


def test_silence_is_an_error_that_names_the_module(two):
    bus, line = two
    line.modules[0].silent = True
    with pytest.raises(NoReplyError, match=r"module 1 does not answer \(no reply\)"):
        position(bus, 1)
    assert (bus.counts[1].timeouts, bus.counts[1].failures) == (4, 1)
    assert position(bus, 2) == 222


@pytest.mark.parametrize("late", [0.03, 0.05, 0.08, 0.12, 0.2])
def test_a_late_reply_is_never_taken_for_anothers(two, late):
    bus, line = two
    line.modules[0].late_by = late
    assert position(bus, 1) == 111
    for _ in range(20):
        assert position(bus, 2) == 222
        assert position(bus, 1) == 111


@pytest.mark.parametrize(
    ("low", "high", "share", "in_order"),
    [
        *((0.03, 0.06, 1.0, False), (0.03, 0.06, 0.2, False), (0.02, 0.1, 0.1, False)),
        *((0.03, 0.06, 0.5, True), (0.05, 0.3, 0.1, True), (0.05, 0.3, 1.0, True)),
    ],
)
def test_on_a_line_whose_replies_come_late_none_is_taken_for_anothers(low, high, share, in_order):
    """A busy host or adapter hands replies on so late that the next one has been asked."""
    rng = np.random.default_rng((7, round(100 * high)))
    line = PicServoLine([SimulatedModule() for _ in range(6)])
    bus = Bus(SimulatedPort(line))
    scan(bus, range(1, 7))
    for k, module in enumerate(line.modules):
        module.shaft = 1000.0 * k
    original, last = line._reply, [0.0]

    def reply(time, rate, replies):
        late = rng.uniform(low, high) if rng.random() < share else 0.0
        if in_order:
            last[0] = max(last[0] + 20 * 10 / 19200, time + late)
            late = last[0] - time
        for module, _ in replies:
            module.late_by = late
        original(time, rate, replies)

    line._reply = reply
    failed = 0
    for _ in range(60):
        for k, module in enumerate(line.modules, 1):
            try:
                assert position(bus, k) == module.shaft
            except NoReplyError:
                failed += 1
    assert failed <= (0 if high <= 0.1 else 180)


def test_a_lost_reply_costs_one_question_more_and_no_pause_that_lasts(two):
    bus, line = two
    line.faults = Wire({2: 0x55})  # the address: nobody feels meant
    begin = bus.port.now()
    assert position(bus, 1) == 111
    assert [position(bus, 2) for _ in range(5)] == [222] * 5
    assert bus.port.now() - begin < 0.25
    begin = bus.port.now()
    assert position(bus, 1) == 111
    assert bus.port.now() - begin == pytest.approx(11 * 10 / 19200 + 0.51e-3, abs=1e-9)


def test_an_interrupted_exchange_does_not_leave_its_reply_to_the_next(two, monkeypatch):
    """Ctrl-C comes between a command and its reply, which arrives when the next module is asked."""
    bus, _ = two
    written = []
    with monkeypatch.context() as interrupted:

        def read(count, timeout):
            if timeout > 0.0:
                raise KeyboardInterrupt
            return b""

        interrupted.setattr(bus.port, "read", read)
        with pytest.raises(KeyboardInterrupt):
            position(bus, 1)
    original = bus.port.write
    monkeypatch.setattr(bus.port, "write", lambda data: (written.append(data), original(data)))
    assert position(bus, 2) == 222
    assert written[0] == FLUSH
    assert bus.counts[2].stray_bytes == 6  # the reply of module 1


def test_garbage_before_a_command_is_thrown_away_and_counted(two):
    bus, _line = two
    position(bus, 1)
    bus.port.write(bytes([0xAA, 2, 0x0E, 0x10]))  # nobody reads it
    bus.port.sleep(0.1)
    assert position(bus, 1) == 111
    assert bus.counts[1].stray_bytes == 2


def test_a_line_of_zeros_is_no_position(two):
    bus, line = two
    line.zeros_only = True
    with pytest.raises(NoReplyError, match="zeros"):
        position(bus, 1)


class EchoPort(SimulatedPort):
    """An adapter that sends back what is written."""

    def write(self, data):
        super().write(data)
        self._buffer += data


def test_an_adapter_that_echoes_is_called_one():
    bus = Bus(EchoPort(PicServoLine([SimulatedModule()])))
    with pytest.raises(BusError, match="echoes"):
        bus.exchange(0, NoOperation(), 0)


class NoisyPort(SimulatedPort):
    """A line that never gets quiet."""

    def read(self, count, timeout):
        self.sleep(1e-3)
        return b"\x55" * count


def test_a_line_that_never_gets_quiet_is_given_up():
    bus = Bus(NoisyPort(PicServoLine([SimulatedModule()])))
    with pytest.raises(BusError, match="never gets quiet: check the baud rate"):
        bus.exchange(1, NoOperation(), 0)
    assert bus.port.now() < 2.0


def test_all_modules_change_their_rate_together(two):
    bus, line = two
    bus.change_rate(115200, [1, 2])
    assert [module.baud for module in line.modules] == [115200, 115200]
    begin = bus.port.now()
    assert position(bus, 2) == 222
    assert bus.port.now() - begin < 2e-3
    with pytest.raises(ValueError, match="9600, 19200, 57600, 115200"):
        bus.change_rate(12345, [1])


def test_a_module_that_does_not_follow_the_rate_is_named(two):
    bus, line = two
    line.modules[1]._do_SetBaud = lambda command: None
    with pytest.raises(NoReplyError, match="module 2"):
        bus.change_rate(57600, [1, 2])


@pytest.mark.parametrize("code", [63, 64])
def test_both_codes_that_libraries_use_for_19200_are_understood(two, code):
    _bus, line = two
    line.modules[0].baud = 9600
    line.modules[0]._do_SetBaud(SetBaud(code))
    assert line.modules[0].baud == 19200


def test_an_unplugged_port_is_an_error_and_comes_back(two):
    bus, _ = two
    bus.port.unplugged = True
    with pytest.raises(PortLostError, match="plug the adapter in again"):
        position(bus, 1)
    bus.port.unplugged = False
    assert position(bus, 1) == 111


def test_threads_take_turns(two):
    bus, _ = two
    wrong = []

    def ask(address, expected):
        wrong.extend(p for _ in range(200) if (p := position(bus, address)) != expected)

    threads = [threading.Thread(target=ask, args=pair) for pair in ((1, 111), (2, 222))]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert wrong == []
    assert bus.total().exchanges == 400
    assert bus.total().damaged == 0


def test_more_attempts_survive_a_worse_line(two):
    bus, line = two
    bus.settings = BusSettings(attempts=12)
    line.faults = WireFaults(np.random.default_rng(3), corrupt=0.03, drop=0.03)
    assert [position(bus, 1) for _ in range(100)] == [111] * 100
    total = bus.counts[1]
    assert total.exchanges == 100
    assert min(total.damaged, total.timeouts, total.stray_bytes) > 0
    assert total.to_mapping()["failures"] == 0
