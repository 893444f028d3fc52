"""Packets of the STS series, through the package `feetech-servo-sdk`, imported as `scservo_sdk`."""

from collections.abc import Sequence

from nico_selfmodel.errors import BusError
from nico_selfmodel.servos.register_servo.sdk import DamagedReplyError, PacketSdk, StatusPacket
from nico_selfmodel.servos.register_servo.sdk_port import SdkPort

_ID, _LENGTH, _ERROR, _DATA = 2, 3, 4, 5


class FeetechSdk(PacketSdk):
    """The packet handler of `scservo_sdk`."""

    overhead = 6

    def __init__(self) -> None:
        """Load the package.

        Raises:
            BusError: If it is missing.
        """
        try:
            from scservo_sdk import PacketHandler
            from scservo_sdk.scservo_def import COMM_RX_TIMEOUT, COMM_SUCCESS, SCS_SETEND
        except ImportError:
            raise BusError(
                "Feetech servos need the package feetech-servo-sdk: install nico-selfmodel[feetech]"
            ) from None
        SCS_SETEND(0)  # of the STS series: low byte first
        self.handler = PacketHandler(0)
        self._success, self._timeout = COMM_SUCCESS, COMM_RX_TIMEOUT

    def sync_read(
        self, port: SdkPort, register: int, length: int, addresses: Sequence[int]
    ) -> None:
        """Ask several servos for the same registers; they answer one after another."""
        self.handler.syncReadTx(port, register, length, list(addresses), len(addresses))

    def receive(self, port: SdkPort) -> StatusPacket:
        """Take one status packet in.

        Raises:
            DamagedReplyError: If none came undamaged.
            BusError: If the adapter sends back what is written to it.
        """
        packet, result = self.handler.rxPacket(port)
        if result != self._success:
            raise DamagedReplyError("no reply" if result == self._timeout else "damaged")
        if bytes(packet) == port.sent:
            raise BusError(
                f"{port.port.name} sends back what is written to it: the adapter echoes; switch "
                "its echo off"
            )
        if packet[_LENGTH] < 2:
            raise DamagedReplyError("damaged")
        end = packet[_LENGTH] + _LENGTH  # without the checksum
        return StatusPacket(packet[_ID], packet[_ERROR], bytes(packet[_DATA:end]))

    def refusal(self, error: int) -> str | None:
        """Return None: these servos tell only what ails them, with every answer."""
        return None
