"""Commands and replies, byte for byte."""

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from nico_selfmodel.servos.pic_servo.protocol.command_packets import (
    COMMANDS,
    command_of,
    encode_command,
    may_repeat,
)
from nico_selfmodel.servos.pic_servo.protocol.commands import (
    ClearBits,
    DefineStatus,
    HardReset,
    IoControl,
    NoOperation,
    PathPoints,
    ReadStatus,
    ResetPosition,
    SaveHome,
    SetAddress,
    SetBaud,
    SetGain,
    SetHoming,
    StartMotion,
    StopMotor,
)
from nico_selfmodel.servos.pic_servo.protocol.gains import Gains
from nico_selfmodel.servos.pic_servo.protocol.packets import DamagedPacketError, Frame, decode_frame
from nico_selfmodel.servos.pic_servo.protocol.status import (
    ITEM_TABLE,
    Status,
    StatusFlag,
    decode_status,
    encode_status,
    reply_length,
)
from nico_selfmodel.servos.pic_servo.protocol.trajectory import (
    LoadTrajectory,
    TrajectoryFlag,
    acceleration_units,
    velocity_units,
)

NOW = TrajectoryFlag.START_NOW
SERVO = TrajectoryFlag.SERVO
VELOCITY = TrajectoryFlag.VELOCITY_MODE
BACK = TrajectoryFlag.REVERSE

# Name as in the published list, address, command, bytes. JR Kerr's and captured packets.
COMMAND_VECTORS = [
    ("hard reset, group 0xFF", 0xFF, HardReset(), "AA FF 0F 0E"),
    ("set address 0->1, group 0xFF", 0, SetAddress(1), "AA 00 21 01 FF 21"),
    ("set address 0->2, group 0xFF", 0, SetAddress(2), "AA 00 21 02 FF 22"),
    ("read device id/version once, module 1", 1, ReadStatus(0x20), "AA 01 13 20 34"),
    ("set baud 57600 (code 0x14), group", 0xFF, SetBaud(0x14), "AA FF 1A 14 2D"),
    ("set baud 115200 (code 0x0A), group", 0xFF, SetBaud(0x0A), "AA FF 1A 0A 23"),
    ("define status 0x1F, module 1", 1, DefineStatus(0x1F), "AA 01 12 1F 32"),
    ("define status pos+aux+perr (0x49), module 1", 1, DefineStatus(0x49), "AA 01 12 49 5C"),
    ("no-op module 1", 1, NoOperation(), "AA 01 0E 0F"),
    (
        "set gain kp200 kd1200 ki150 il15 ol75 cl0 el4000 sr5 db0",
        1,
        SetGain(Gains(200, 1200, 150, 15, 75, 0, 4000, 5, 0, None)),
        "AA 01 E6 C8 00 B0 04 96 00 0F 00 4B 00 A0 0F 05 00 07",
    ),
    (
        "set gain kp100 kd1000 ki0 il0 ol255 cl0 el4000 sr1 db0 sm1 (SC, 15 bytes)",
        1,
        SetGain(Gains()),
        "AA 01 F6 64 00 E8 03 00 00 00 00 FF 00 A0 0F 01 00 01 F6",
    ),
    ("stop motor: motor off, amp off", 1, StopMotor(0x02), "AA 01 17 02 1A"),
    ("stop motor: amp enable + motor off", 1, StopMotor(0x03), "AA 01 17 03 1B"),
    (
        "stop motor: amp enable + stop abrupt (servo on here)",
        *(1, StopMotor(0x05), "AA 01 17 05 1D"),
    ),
    ("stop motor: amp enable + stop smooth", 1, StopMotor(0x09), "AA 01 17 09 21"),
    (
        "group E-stop: amp enable + stop abrupt to 0xFF",
        *(0xFF, StopMotor(0x05), "AA FF 17 05 1B"),
    ),
    (
        "stop here: amp enable + stop here at +1000",
        *(1, StopMotor(0x11, 1000), "AA 01 57 11 E8 03 00 00 54"),
    ),
    ("clear bits", 1, ClearBits(), "AA 01 0B 0C"),
    ("reset position", 1, ResetPosition(), "AA 01 00 01"),
    ("SC: set position to -5000", 1, ResetPosition(2, -5000), "AA 01 50 02 78 EC FF FF B5"),
    ("SC: reset relative to home", 1, ResetPosition(1), "AA 01 10 01 12"),
    ("I/O control: 3-phase (SC/3PH)", 1, IoControl(0x10), "AA 01 18 10 29"),
    ("I/O control: 3-phase + motor off on limit", 1, IoControl(0x14), "AA 01 18 14 2D"),
    (
        "load traj pos=0 vel=0x28F5C3 acc=0x1AD7 servo start",
        1,
        LoadTrajectory(SERVO | NOW, 0, 0x28F5C3, 0x1AD7),
        "AA 01 D4 97 00 00 00 00 C3 F5 28 00 D7 1A 00 00 3D",
    ),
    (
        "load traj vel mode vel=0x8312 acc=0x112",
        1,
        LoadTrajectory(SERVO | VELOCITY | NOW, None, 0x8312, 0x112),
        "AA 01 94 B6 12 83 00 00 12 01 00 00 F3",
    ),
    (
        "load traj pos=-2000 vel=335544 (10000 counts/s) acc=344 (20000 counts/s^2) servo start",
        1,
        LoadTrajectory(SERVO | NOW, -2000, velocity_units(10_000), acceleration_units(20_000)),
        "AA 01 D4 97 30 F8 FF FF B8 1E 05 00 58 01 00 00 C6",
    ),
    (
        "load traj pos+acc, no start (cmd 0x94 ctl 0x15), pos=1000 acc=100",
        *(1, LoadTrajectory(SERVO, 1000, None, 100), "AA 01 94 15 E8 03 00 00 64 00 00 00 F9"),
    ),
    ("load traj PWM=64 forward now", 1, LoadTrajectory(NOW, pwm=64), "AA 01 24 88 40 ED"),
    ("load traj PWM=64 reverse now", 1, LoadTrajectory(NOW | BACK, pwm=64), "AA 01 24 C8 40 2D"),
    (
        "load traj velocity mode reverse 5000 counts/s",
        1,
        LoadTrajectory(
            SERVO | VELOCITY | BACK | NOW, None, velocity_units(5000), acceleration_units(20_000)
        ),
        "AA 01 94 F6 5C 8F 02 00 58 01 00 00 D1",
    ),
    ("start motion, group 0xFF", 0xFF, StartMotion(), "AA FF 05 04"),
    (
        "set group 0x80, module 3 as leader",
        *(3, SetAddress(3, 0x80, leader=True), "AA 03 21 03 00 27"),
    ),
    ("set group 0x80, module 4 as member", 4, SetAddress(4, 0x80), "AA 04 21 04 80 A9"),
    ("set homing index + smooth stop (0x28)", 1, SetHoming(0x28), "AA 01 19 28 42"),
    ("save current as home, group", 0xFF, SaveHome(), "AA FF 0C 0B"),
    (
        "add 2 path points +10,-10 counts @30 Hz",
        *(1, PathPoints((0x2A, 0x2B)), "AA 01 4D 2A 00 2B 00 A3"),
    ),
    ("start path mode, module 1", 1, PathPoints(), "AA 01 0D 0E"),
    (
        "SC: hard reset saving config (save|restore addr|amp|3ph = 0x47)",
        *(1, HardReset(0x47), "AA 01 1F 47 67"),
    ),
]
REPLY_VECTORS = [
    (
        "status reply: stat=0x08, type 0, ver 10",
        0x20,
        Status(StatusFlag.POWER_ON, device_type=0, device_version=10),
        "08 00 0A 12",
    ),
    (
        "reply to 0x1F status: stat 0x11 pos 0x2522 ad 0x4F vel 0 aux 0x18 home 0x05E0",
        0x1F,
        Status(StatusFlag(0x11), 0x2522, current=0x4F, velocity=0, auxiliary=0x18, home=0x05E0),
        "11 22 25 00 00 4F 00 00 18 E0 05 00 00 A4",
    ),
    (
        "reply with command checksum error flagged (stat 0x0A)",
        *(0, Status(StatusFlag.POWER_ON | StatusFlag.CHECKSUM_ERROR), "0A 0A"),
    ),
]


def decode_command(packet):
    """Return address and typed command of a packet."""
    frame = decode_frame(packet)
    return frame.address, command_of(frame)


@pytest.mark.parametrize(
    ("address", "command", "text"), [v[1:] for v in COMMAND_VECTORS], ids=lambda v: str(v)[:40]
)
def test_a_command_is_these_bytes_and_these_bytes_are_the_command(address, command, text):
    packet = bytes.fromhex(text)
    assert encode_command(address, command) == packet
    assert decode_command(packet) == (address, command)


@pytest.mark.parametrize(("items", "status", "text"), [v[1:] for v in REPLY_VECTORS])
def test_a_reply_is_these_bytes_and_these_bytes_are_the_reply(items, status, text):
    packet = bytes.fromhex(text)
    assert encode_status(items, status) == packet
    assert decode_status(items, packet) == status


@pytest.mark.real_data
def test_every_published_vector_is_among_those_tested_here(published_vectors):
    ours = {name: bytes.fromhex(text) for name, *_, text in COMMAND_VECTORS + REPLY_VECTORS}
    assert ours == published_vectors
    assert len(ours) == 41


def test_every_command_has_a_vector_and_a_code():
    tested = {type(command) for _, _, command, _ in COMMAND_VECTORS}
    assert tested == set(COMMANDS.values())
    assert sorted(COMMANDS) == list(range(16))


def test_a_lost_reply_allows_only_some_commands_to_be_repeated():
    assert may_repeat(LoadTrajectory(SERVO | NOW, 5))
    assert may_repeat(LoadTrajectory(SERVO | VELOCITY | BACK | NOW, velocity=1))
    assert not may_repeat(LoadTrajectory(SERVO | BACK | NOW, 5))  # relative
    assert not any(map(may_repeat, (SetAddress(1), ResetPosition(), PathPoints((1,)))))
    assert not any(map(may_repeat, (HardReset(), SetHoming(0x28), SaveHome())))


@given(st.binary(max_size=24))
@example(b"")
@example(b"\xaa\x01\x04\x05")
@example(b"\xaa" * 19)
def test_any_bytes_are_a_command_or_a_damaged_packet(data):
    try:
        address, command = decode_command(data)
    except DamagedPacketError:
        return
    assert encode_command(address, command)[1] == address


@given(st.integers(0, 255), st.integers(0, 15), st.binary(max_size=15))
def test_any_frame_is_a_command_or_damaged_and_comes_back_the_same(address, code, data):
    frame = Frame(address, code, data)
    packet = frame.encode()
    assert decode_frame(packet) == frame
    try:
        _, command = decode_command(packet)
    except DamagedPacketError:
        return
    again = encode_command(address, command)
    assert decode_command(again) == (address, command)


@given(st.integers(0, 255), st.binary(max_size=24))
@example(0xFF, b"\x00" * 19)
def test_any_bytes_are_a_reply_or_a_damaged_packet(items, data):
    try:
        status = decode_status(items, data)
    except DamagedPacketError:
        return
    assert encode_status(items, status) == data


@given(st.integers(0, 255), st.binary(min_size=18, max_size=18), st.data())
def test_one_changed_byte_never_goes_unnoticed(items, content, data):
    body = content[: reply_length(items) - 1]
    packet = bytearray(body + bytes([sum(body) & 0xFF]))
    place = data.draw(st.integers(0, len(packet) - 1))
    packet[place] ^= data.draw(st.integers(1, 255))
    with pytest.raises(DamagedPacketError):
        decode_status(items, bytes(packet))


def test_a_line_that_reads_only_zeros_is_no_reply():
    with pytest.raises(DamagedPacketError, match="zeros"):
        decode_status(0x49, bytes(9))


def test_the_items_of_a_reply_take_seventeen_bytes_together():
    assert reply_length(0xFF) == 19
    assert sum(item for item, _, _ in ITEM_TABLE) == 0xFF
    assert [reply_length(1 << bit) - 2 for bit in range(8)] == [4, 1, 2, 1, 4, 2, 2, 1]


def test_speeds_are_counts_a_tick_times_65536():
    assert velocity_units(1953.125) == 65536
    assert acceleration_units(1953.125**2) == 65536
    # A slower loop counts more in each of its ticks.
    assert velocity_units(1953.125, rate_divisor=2) == 2 * 65536
    assert acceleration_units(1953.125**2, rate_divisor=2) == 4 * 65536
    assert acceleration_units(1.0) == 1  # 0 would never start


@pytest.mark.parametrize("speed", [-1.0, float("nan"), float("inf"), 2.6e6])
def test_a_speed_that_the_chip_cannot_hold_is_refused(speed):
    with pytest.raises(ValueError, match="velocity must be between"):
        velocity_units(speed)


def test_values_that_do_not_fit_are_refused():
    with pytest.raises(ValueError, match="cannot be sent"):
        encode_command(1, LoadTrajectory(SERVO | NOW, 2**31))
    with pytest.raises(ValueError, match="error_limit must be 1 to 16383"):
        Gains(error_limit=20_000).check()
    with pytest.raises(ValueError, match="address"):
        Frame(300, 1)
    with pytest.raises(ValueError, match="15 data bytes"):
        Frame(1, 1, bytes(16))
    with pytest.raises(ValueError, match="cannot be sent"):
        encode_status(0x01, Status(StatusFlag(0)))
