"""Packets of protocol 2.0, as a servo reads and writes them.

Robotis e-Manual, Protocol 2.0: FF FF FD 00, id, length (2), instruction, parameters, CRC-16 (2).
"""

from nico_selfmodel.servos.register_servo.simulated.line import Instruction

HEADER = b"\xff\xff\xfd"
STATUS = 0x55
_HEAD = 7
"""Bytes before those that the length counts."""
_LONGEST = 1024
_POLYNOMIAL = 0x8005


def _table() -> list[int]:
    table = []
    for value in range(256):
        crc = value << 8
        for _ in range(8):
            crc = (crc << 1) ^ (_POLYNOMIAL if crc & 0x8000 else 0)
        table.append(crc & 0xFFFF)
    return table


_TABLE = _table()


def _crc16(data: bytes) -> int:
    """Return the checksum: CRC-16 with the polynomial 0x8005, begun with 0 (CRC-16/UMTS)."""
    crc = 0
    for byte in data:
        crc = ((crc << 8) & 0xFFFF) ^ _TABLE[(crc >> 8) ^ byte]
    return crc


def encode(address: int, instruction: int, parameters: bytes) -> bytes:
    """Return a packet; a header within is stuffed with FD."""
    body = (bytes((instruction,)) + parameters).replace(HEADER, HEADER + b"\xfd")
    length = len(body) + 2
    packet = HEADER + bytes((0, address, length & 0xFF, length >> 8)) + body
    return packet + _crc16(packet).to_bytes(2, "little")


class DynamixelFraming:
    """How packets look."""

    def take(self, heard: bytearray) -> Instruction | None:
        """Take the first undamaged packet out of what was heard, with all that stands before it."""
        while True:
            begin = heard.find(HEADER + b"\x00")
            if begin < 0:
                del heard[: max(0, len(heard) - len(HEADER))]
                return None
            del heard[:begin]
            if len(heard) < _HEAD:
                return None
            length = heard[5] | heard[6] << 8
            if not 3 <= length <= _LONGEST:
                del heard[: len(HEADER)]
                continue
            if len(heard) < _HEAD + length:
                return None
            packet = bytes(heard[: _HEAD + length])
            if _crc16(packet[:-2]) != int.from_bytes(packet[-2:], "little"):
                del heard[: len(HEADER)]
                continue
            del heard[: _HEAD + length]
            body = packet[_HEAD:-2].replace(HEADER + b"\xfd", HEADER)
            if body[0] != STATUS:
                return Instruction(packet[4], body[0], body[1:])

    def answer(self, address: int, error: int, data: bytes) -> bytes:
        """Return a status packet."""
        return encode(address, STATUS, bytes((error,)) + data)

    def registers(self, parameters: bytes) -> tuple[int, int, bytes]:
        """Return the register, the length and the rest that parameters begin with."""
        register, length = (int.from_bytes(parameters[k : k + 2], "little") for k in (0, 2))
        return register, length, parameters[4:]

    def target(self, parameters: bytes) -> tuple[int, bytes]:
        """Return the register that is written, and its data."""
        return int.from_bytes(parameters[:2], "little"), parameters[2:]
