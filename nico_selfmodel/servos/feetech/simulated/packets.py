"""Packets of the STS series, as a servo reads and writes them.

Feetech's protocol manual: FF FF, id, length, instruction, parameters, an inverted sum of 8 bits.
"""

from nico_selfmodel.servos.register_servo.simulated.line import Instruction

HEADER = b"\xff\xff"
_HEAD = 4
"""Bytes before those that the length counts."""


def checksum(data: bytes) -> int:
    """Return the checksum of what follows the header."""
    return ~sum(data) & 0xFF


def encode(address: int, instruction: int, parameters: bytes) -> bytes:
    """Return a packet; of a status packet the instruction is its error."""
    body = bytes((address, len(parameters) + 2, instruction)) + parameters
    return HEADER + body + bytes((checksum(body),))


class FeetechFraming:
    """How packets look."""

    def take(self, heard: bytearray) -> Instruction | None:
        """Take the first undamaged packet out of what was heard, with all that stands before it."""
        while True:
            begin = heard.find(HEADER)
            if begin < 0:
                del heard[: max(0, len(heard) - 1)]
                return None
            del heard[:begin]
            if len(heard) < _HEAD:
                return None
            if heard[2] == 0xFF or heard[3] < 2:
                del heard[0]
                continue
            end = _HEAD + heard[3]
            if len(heard) < end:
                return None
            packet = bytes(heard[:end])
            if checksum(packet[2:-1]) != packet[-1]:
                del heard[0]
                continue
            del heard[:end]
            return Instruction(packet[2], packet[4], packet[5:-1])

    def answer(self, address: int, error: int, data: bytes) -> bytes:
        """Return a status packet."""
        return encode(address, error, data)

    def registers(self, parameters: bytes) -> tuple[int, int, bytes]:
        """Return the register, the length and the rest that parameters begin with."""
        return parameters[0], parameters[1], parameters[2:]

    def target(self, parameters: bytes) -> tuple[int, bytes]:
        """Return the register that is written, and its data."""
        return parameters[0], parameters[1:]
