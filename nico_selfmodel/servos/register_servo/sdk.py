"""What both makers' SDKs do, in one form: packets out, status packets in."""

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from nico_selfmodel.servos.register_servo.sdk_port import SdkPort


class DamagedReplyError(Exception):
    """A status packet came damaged, short, or not at all."""


@dataclass(frozen=True)
class StatusPacket:
    """What a servo answered."""

    address: int
    error: int
    data: bytes


class PacketSdk(ABC):
    """A packet handler of an SDK; each method sends exactly one packet, or takes one in."""

    overhead: int
    """Bytes of a status packet besides its data."""
    handler: Any
    """The SDK's own packet handler."""

    def read(self, port: SdkPort, address: int, register: int, length: int) -> None:
        """Ask a servo for registers."""
        self.handler.readTx(port, address, register, length)

    def write(self, port: SdkPort, address: int, register: int, data: bytes) -> None:
        """Write registers of a servo."""
        self.handler.writeTxOnly(port, address, register, len(data), list(data))

    def sync_write(self, port: SdkPort, register: int, data: dict[int, bytes]) -> None:
        """Write the same registers of several servos; nobody answers."""
        length = len(next(iter(data.values())))
        parameters = [byte for address, block in data.items() for byte in (address, *block)]
        self.handler.syncWriteTxOnly(port, register, length, parameters, len(parameters))

    @abstractmethod
    def sync_read(
        self, port: SdkPort, register: int, length: int, addresses: Sequence[int]
    ) -> None:
        """Ask several servos for the same registers; they answer one after another."""

    @abstractmethod
    def receive(self, port: SdkPort) -> StatusPacket:
        """Take one status packet in, before the port's patience ends.

        Raises:
            DamagedReplyError: If none came undamaged.
        """

    @abstractmethod
    def refusal(self, error: int) -> str | None:
        """Return why a servo refused a packet, by the error of its answer; None if it did not."""
