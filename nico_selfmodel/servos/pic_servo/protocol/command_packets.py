"""Typed commands to packets and back: which class belongs to which code."""

import struct

from nico_selfmodel.servos.pic_servo.protocol.commands import (
    ClearBits,
    Command,
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
from nico_selfmodel.servos.pic_servo.protocol.packets import DamagedPacketError, Frame
from nico_selfmodel.servos.pic_servo.protocol.trajectory import LoadTrajectory

COMMANDS: dict[int, type[Command]] = {
    kind.code: kind
    for kind in (
        *(ResetPosition, SetAddress, DefineStatus, ReadStatus, LoadTrajectory, StartMotion),
        *(SetGain, StopMotor, IoControl, SetHoming, SetBaud, ClearBits, SaveHome, PathPoints),
        *(NoOperation, HardReset),
    )
}


def encode_command(address: int, command: Command) -> bytes:
    """Return the packet that sends a command to a module or a group.

    Raises:
        ValueError: If a value does not fit its place.
    """
    try:
        return Frame(address, command.code, command.payload()).encode()
    except struct.error as error:
        raise ValueError(f"{command} cannot be sent: {error}") from None


def may_repeat(command: Command) -> bool:
    """Return whether a command may be sent again when nobody knows if it was carried out."""
    return command.repeatable and not (isinstance(command, LoadTrajectory) and command.relative)


def command_of(frame: Frame) -> Command:
    """Return the typed command of a frame.

    Raises:
        DamagedPacketError: If no command has this code with so many data bytes.
    """
    kind = COMMANDS[frame.code]
    if len(frame.data) not in kind.lengths:
        expected = " or ".join(map(str, kind.lengths))
        raise DamagedPacketError(
            f"{kind.__name__} with {len(frame.data)} data bytes, expected {expected}"
        )
    return kind.from_payload(frame.data)
