"""Frames of the NMC protocol: a command with its header and checksum, a reply with its checksum.

    command   AA  address  (n << 4 | code)  n data bytes  checksum
    reply     status byte  k data bytes  checksum

A checksum is the sum modulo 256 of all bytes before it, without the header. A reply carries neither
an address nor a length: only who asked can know whose it is and how long.
"""

from dataclasses import dataclass

from nico_selfmodel.errors import BusError

HEADER = 0xAA
UNADDRESSED = 0x00
"""Address of a module that was not given one since it was reset."""
LAST_ADDRESS = 0x7F
EVERYONE = 0xFF
"""The group that every module is in after a reset."""
FIRST_GROUP = 0x80
LONGEST_DATA = 15
SHORTEST_COMMAND = 4


class DamagedPacketError(BusError):
    """Bytes that are not a whole, undamaged packet."""


@dataclass(frozen=True)
class Frame:
    """A command as it stands on the wire, its data not yet understood."""

    address: int
    """0x00 unaddressed, 0x01-0x7F a module, 0x80-0xFF a group."""
    code: int
    """Which of the sixteen commands, 0-15."""
    data: bytes = b""
    """Up to 15 bytes."""

    def __post_init__(self) -> None:
        """Check that the parts fit their places."""
        if not 0 <= self.address <= 0xFF or not 0 <= self.code <= 0xF:
            raise ValueError(
                f"address must be 0-255 and code 0-15, got {self.address} and {self.code}"
            )
        if len(self.data) > LONGEST_DATA:
            raise ValueError(f"a command has at most 15 data bytes, got {len(self.data)}")

    def encode(self) -> bytes:
        """Return the bytes to send."""
        body = bytes([self.address, len(self.data) << 4 | self.code]) + self.data
        return bytes([HEADER]) + body + bytes([checksum(body)])


def checksum(data: bytes) -> int:
    """Return the sum of the bytes modulo 256."""
    return sum(data) & 0xFF


def decode_frame(packet: bytes) -> Frame:
    """Take a command packet apart.

    Args:
        packet: The whole packet and nothing else.

    Raises:
        DamagedPacketError: If header, length or checksum are wrong.
    """
    if len(packet) < SHORTEST_COMMAND or packet[0] != HEADER:
        raise DamagedPacketError(f"not a command packet: {packet.hex(' ') or 'nothing'}")
    length = SHORTEST_COMMAND + (packet[2] >> 4)
    if len(packet) != length:
        raise DamagedPacketError(
            f"command packet of {len(packet)} bytes, {length} announced: {packet.hex(' ')}"
        )
    check_sum(packet[1:], packet)
    return Frame(packet[1], packet[2] & 0xF, bytes(packet[3:-1]))


def check_sum(summed: bytes, packet: bytes) -> None:
    """Refuse bytes whose last one is not the checksum of those before it.

    Args:
        summed: The bytes, the checksum among them.
        packet: What the message shows.

    Raises:
        DamagedPacketError: If it is not.
    """
    expected = checksum(summed[:-1])
    if summed[-1] != expected:
        raise DamagedPacketError(
            f"checksum {summed[-1]:02x}, expected {expected:02x}: {packet.hex(' ')}"
        )
