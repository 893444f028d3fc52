"""Packets of protocol 2.0, through the package `dynamixel-sdk`."""

from collections.abc import Sequence

from nico_selfmodel.errors import BusError
from nico_selfmodel.servos.register_servo.sdk import DamagedReplyError, PacketSdk, StatusPacket
from nico_selfmodel.servos.register_servo.sdk_port import SdkPort

ALERT = 0x80
"""Bit of a status packet's error: the servo's hardware error register says what is wrong."""
_ID, _ERROR, _DATA, _CHECKSUM = 4, 8, 9, 2
_MISSING = (
    "Dynamixel servos need the package dynamixel-sdk, 4.1 or later: install "
    "nico-selfmodel[dynamixel]"
)
_REFUSALS = {
    1: "it could not be carried out",
    2: "the instruction is not known to it",
    3: "the packet came damaged",
    4: "the value is out of range",
    5: "the value has the wrong length",
    6: "the value is beyond the servo's own limits",
    7: "the register may not be written now",
}


class DynamixelSdk(PacketSdk):
    """The protocol 2.0 handler of `dynamixel-sdk`."""

    overhead = 11

    def __init__(self) -> None:
        """Load the package.

        Raises:
            BusError: If it is missing.
        """
        try:
            from dynamixel_sdk import PacketHandler, robotis_def
        except ImportError:
            raise BusError(_MISSING) from None
        if not hasattr(robotis_def, "INST_FAST_SYNC_READ"):  # its methods take other arguments
            raise BusError(_MISSING)
        self.handler = PacketHandler(2.0)
        self._success, self._timeout = robotis_def.COMM_SUCCESS, robotis_def.COMM_RX_TIMEOUT

    def sync_read(
        self, port: SdkPort, register: int, length: int, addresses: Sequence[int]
    ) -> None:
        """Ask several servos for the same registers; they answer one after another."""
        self.handler.syncReadTx(port, register, length, list(addresses), len(addresses), False)

    def reboot(self, port: SdkPort, address: int) -> None:
        """Let a servo start anew: what it holds falls, and an overload is forgotten."""
        packet = [0, 0, 0, 0, address, 3, 0, 8, 0, 0]  # the SDK's own method would wait, too
        self.handler.txPacket(port, packet)

    def receive(self, port: SdkPort) -> StatusPacket:
        """Take one status packet in.

        Raises:
            DamagedReplyError: If none came undamaged.
        """
        packet, result = self.handler.rxPacket(port, False)
        if result != self._success:
            raise DamagedReplyError("no reply" if result == self._timeout else "damaged")
        # Stuffing was taken out, which the length of the packet now counts.
        end = packet[5] + (packet[6] << 8) + 7 - _CHECKSUM
        return StatusPacket(packet[_ID], packet[_ERROR], bytes(packet[_DATA:end]))

    def refusal(self, error: int) -> str | None:
        """Return why a servo refused a packet, None if it did not."""
        code = error & ~ALERT
        return _REFUSALS.get(code, f"error {code}") if code else None
