"""What a module answers: status byte, and the items that its status mask asks for.

Bits and order of the items are those of JR Kerr's own library and of captured traffic.
"""

import struct
from dataclasses import dataclass
from enum import IntFlag
from functools import cache

from nico_selfmodel.servos.pic_servo.protocol.packets import DamagedPacketError, check_sum, checksum


class StatusFlag(IntFlag):
    """The status byte of every reply."""

    MOVE_DONE = 0x01
    """Set unless a trapezoidal move runs or a velocity is being reached; also when off."""
    CHECKSUM_ERROR = 0x02
    """The command just received was damaged and was not carried out."""
    OVERCURRENT = 0x04
    """The current limit was hit; stays until cleared."""
    POWER_ON = 0x08
    """There is power for the motor."""
    POSITION_ERROR = 0x10
    """The error exceeded its limit; stays until cleared, and is set whenever the servo is off."""
    LIMIT_1 = 0x20
    LIMIT_2 = 0x40
    HOMING = 0x80
    """Waiting for the event that marks home."""


class AuxiliaryFlag(IntFlag):
    """The auxiliary status byte."""

    INDEX = 0x01
    POSITION_WRAP = 0x02
    SERVO_ON = 0x04
    ACCELERATION_DONE = 0x08
    SLEW_DONE = 0x10
    SERVO_OVERRUN = 0x20
    PATH_MODE = 0x40


class StatusItem(IntFlag):
    """Which items a reply carries; they are sent in this order."""

    POSITION = 0x01
    CURRENT = 0x02
    VELOCITY = 0x04
    AUXILIARY = 0x08
    HOME = 0x10
    DEVICE = 0x20
    POSITION_ERROR = 0x40
    PATH_POINTS = 0x80


# Item, fields of `Status` that it fills, and how they are packed (least significant byte first).
ITEM_TABLE: tuple[tuple[StatusItem, tuple[str, ...], str], ...] = (
    (StatusItem.POSITION, ("position",), "i"),
    (StatusItem.CURRENT, ("current",), "B"),
    (StatusItem.VELOCITY, ("velocity",), "h"),
    (StatusItem.AUXILIARY, ("auxiliary",), "B"),
    (StatusItem.HOME, ("home",), "i"),
    (StatusItem.DEVICE, ("device_type", "device_version"), "BB"),
    (StatusItem.POSITION_ERROR, ("position_error",), "h"),
    (StatusItem.PATH_POINTS, ("path_points",), "B"),
)
WATCHED = StatusItem.POSITION | StatusItem.AUXILIARY | StatusItem.POSITION_ERROR
"""What the driver has every reply carry: enough to see where an axis is and what ails it."""

DEVICE_TYPES = {0: "PIC-SERVO", 1: "PIC-ADC", 2: "PIC-IO", 3: "PIC-STEP"}


@dataclass(frozen=True)
class Status:
    """A reply, understood. An item that it did not carry is None."""

    flags: StatusFlag
    position: int | None = None
    """Counts."""
    current: int | None = None
    """Reading of the current sense, 0-255."""
    velocity: int | None = None
    """Counts a servo tick; coarse, and its sign depends on the wiring."""
    auxiliary: AuxiliaryFlag | None = None
    home: int | None = None
    """Home register, counts."""
    device_type: int | None = None
    device_version: int | None = None
    position_error: int | None = None
    """Commanded less actual position, counts."""
    path_points: int | None = None
    """Path points that wait."""


def reply_length(items: int) -> int:
    """Return the number of bytes of a reply that carries these items."""
    return 2 + struct.calcsize(_layout(items))


def decode_status(items: int, reply: bytes) -> Status:
    """Understand a reply.

    Args:
        items: The status mask under which it was sent.
        reply: The bytes, status byte to checksum.

    Raises:
        DamagedPacketError: If its length or checksum is wrong, or it is all zeros (which a dead
            line gives, and which passes the checksum).
    """
    if len(reply) != reply_length(items):
        raise DamagedPacketError(
            f"reply of {len(reply)} bytes, expected {reply_length(items)}: "
            f"{reply.hex(' ') or 'nothing'}"
        )
    check_sum(reply, reply)
    if not any(reply):
        raise DamagedPacketError(f"reply of {len(reply)} zeros: nothing drives the line")
    values = dict(zip(_fields(items), struct.unpack_from(_layout(items), reply, 1), strict=True))
    if values.get("auxiliary") is not None:
        values["auxiliary"] = AuxiliaryFlag(values["auxiliary"])
    return Status(StatusFlag(reply[0]), **values)


def encode_status(items: int, status: Status) -> bytes:
    """Return the reply that a module sends.

    Args:
        items: Its status mask.
        status: What it has to say; every item of the mask must be there.

    Returns:
        The bytes, status byte to checksum.

    Raises:
        ValueError: If an item is missing or does not fit its place.
    """
    values = [getattr(status, name) for name in _fields(items)]
    try:
        body = bytes([status.flags]) + struct.pack(_layout(items), *values)
    except struct.error as error:
        raise ValueError(f"{status} cannot be sent with items {items:#04x}: {error}") from None
    return body + bytes([checksum(body)])


@cache
def _layout(items: int) -> str:
    return "<" + "".join(layout for item, _, layout in ITEM_TABLE if items & item)


@cache
def _fields(items: int) -> tuple[str, ...]:
    return tuple(name for item, names, _ in ITEM_TABLE if items & item for name in names)
