"""The modules of a bus together: who is there, addresses along the chain, all at once."""

from collections.abc import Sequence
from dataclasses import dataclass
from zlib import crc32

from nico_selfmodel.errors import BusError
from nico_selfmodel.servos.bus_settings import NoReplyError
from nico_selfmodel.servos.pic_servo.line.board import DeviceId, PicServo, is_marked
from nico_selfmodel.servos.pic_servo.line.bus import Bus, UncertainError
from nico_selfmodel.servos.pic_servo.protocol import commands as nmc
from nico_selfmodel.servos.pic_servo.protocol.commands import StopMode
from nico_selfmodel.servos.pic_servo.protocol.packets import EVERYONE, FIRST_GROUP, UNADDRESSED
from nico_selfmodel.servos.pic_servo.protocol.status import AuxiliaryFlag, Status, StatusItem

LONGEST_CHAIN = 32
_SURE = 3
_RESET = 0.1
"""How long a module takes to start anew [s]."""
_LOOKS = StatusItem.POSITION | StatusItem.DEVICE | StatusItem.AUXILIARY | StatusItem.HOME


@dataclass(frozen=True)
class FoundModule:
    """A module as a scan found it."""

    address: int
    device: DeviceId
    status: Status
    newly_addressed: bool
    """Whether this scan gave it its address: then it was powered up or reset since the last."""

    @property
    def servo_on(self) -> bool:
        """Whether it holds its motor."""
        return bool((self.status.auxiliary or 0) & AuxiliaryFlag.SERVO_ON)

    @property
    def zero_known(self) -> bool:
        """Whether its zero was set since it was powered up."""
        return is_marked(self.status)


def scan(
    bus: Bus, addresses: Sequence[int] | None = None, *, attempts: int = 2, whole: bool = False
) -> list[FoundModule]:
    """Find all modules and give addresses to those that have none. Moves nothing.

    Args:
        addresses: Where to look, and what the modules along the chain are to be called; 1 to 32
            if omitted.
        attempts: How often to ask an address that is silent.
        whole: Whether these are all modules of the chain in its order. New ones are then refused
            where they cannot be told apart; they are put back to having no address.

    Returns:
        The modules by address; empty if none answers.

    Raises:
        BusError: If a module answers with damage only, as two on one address do, or a new one may
            be another than the addresses say.
    """
    order = list(addresses or range(1, LONGEST_CHAIN + 1))
    known = [address for address in order if anybody(bus, address, attempts) is not None]
    fresh = _assign(bus, order, known, whole=whole)
    if whole and (known or fresh) and _somebody_waits(bus):
        _forget(bus, fresh)
        raise BusError(
            f"a module without an address waits behind the {len(order)} of the configuration "
            f"({', '.join(map(str, order))}): use a configuration of the whole chain, or let "
            "`servo scan` number the chain from 1 on and give joints these addresses"
        )
    found = []
    for address in sorted([*known, *fresh]):
        status = _look(bus, address, _LOOKS)
        assert status.device_type is not None
        assert status.device_version is not None
        device = DeviceId(status.device_type, status.device_version)
        found.append(FoundModule(address, device, status, address in fresh))
    return found


def _assign(bus: Bus, order: Sequence[int], known: list[int], *, whole: bool) -> list[int]:
    """Give addresses to the modules that wake up one after another at address 0.

    Args:
        order: What modules along the chain are to be called.
        known: Where somebody answered; grows by who was only slow.
        whole: Whether a new module must stand behind all that have an address.

    Returns:
        The addresses given.
    """
    fresh: list[int] = []
    for k, address in enumerate(order):
        if address in known:
            continue
        if anybody(bus, UNADDRESSED) is None:
            return fresh
        if anybody(bus, address, _SURE) is not None:
            known.append(address)  # it was only slow: no second module must get its address
            continue
        if whole and any(other in known for other in order[k + 1 :]):
            if not _somebody_waits(bus):
                return fresh
            _give_back(bus, order[k : k + 2], known, fresh)
        else:
            _give(bus, address)
        fresh.append(address)
    return fresh


def _give_back(bus: Bus, places: Sequence[int], known: list[int], fresh: Sequence[int]) -> None:
    """Give an address to a module before others that have theirs: only one that was reset alone.

    Such a one kept the module behind it from answering, which then does so at its own address.

    Args:
        places: The address, and that of the module behind it.
        known: Where somebody answers; grows by the module behind.
        fresh: Addresses that were just given.

    Raises:
        BusError: If it may be another module.
    """
    address, following = places
    if following not in known:
        _give(bus, address)
        if anybody(bus, UNADDRESSED) is None and anybody(bus, following, _SURE) is not None:
            known.append(following)
            return
        fresh = [*fresh, address]
    _forget(bus, fresh)
    raise BusError(
        f"a module without an address may be another than module {address}, as modules behind "
        "that have their addresses: support the arm, switch all boards off and on, and home it "
        "again"
    )


def _somebody_waits(bus: Bus) -> bool:
    """Return whether a module has no address: damage that shows nowhere must not say so."""
    return all(anybody(bus, UNADDRESSED) is not None for _ in range(_SURE))


def _give(bus: Bus, address: int) -> None:
    """Give an address to the module that waits at address 0."""
    try:
        bus.exchange(UNADDRESSED, nmc.SetAddress(address, EVERYONE), 0)
    except UncertainError as error:
        # Repeating it could give the next module the same address.
        if anybody(bus, address) is None:
            raise BusError(
                f"module {address} of the chain could not be given its address: {error}"
            ) from error


def _forget(bus: Bus, fresh: Sequence[int]) -> None:
    """Take the addresses away again that were just given: else the next program trusts them.

    Such modules were powered up since they were last used: they are off and know no zero, so that
    a reset takes nothing from them.
    """
    for address in reversed(fresh):
        if (_look(bus, address, StatusItem.AUXILIARY).auxiliary or 0) & AuxiliaryFlag.SERVO_ON:
            continue
        for _ in range(2):  # nobody confirms
            bus.send(address, nmc.HardReset())
            bus.wait(_RESET)


def anybody(bus: Bus, address: int, attempts: int = 2) -> Status | None:
    """Return what the module at an address says, None if there is silence.

    Raises:
        BusError: If something answers, but always damaged.
    """
    before = bus.counts[address].damaged
    try:
        return bus.exchange(
            address, nmc.ReadStatus(StatusItem.DEVICE), StatusItem.DEVICE, attempts=attempts
        )
    except NoReplyError:
        if bus.counts[address].damaged - before < 2:
            return None
    return _look(bus, address, StatusItem.DEVICE)


def _look(bus: Bus, address: int, items: int) -> Status:
    before = bus.counts[address].damaged
    try:
        return bus.exchange(address, nmc.ReadStatus(items), items)
    except NoReplyError as error:
        if bus.counts[address].damaged == before:
            raise
        raise BusError(
            f"address {address} answers, but every reply is damaged: two modules have this "
            "address, or the baud rate is wrong. Support the arm, switch the boards off and on, "
            "then scan"
        ) from error


def join_group(module: PicServo, group: int) -> None:
    """Let a module obey the packets to a group, silently.

    Raises:
        BusError: If it does not answer.
    """
    # Not at address 0 any more, so that repeating it harms nobody.
    module.ask(nmc.SetAddress(module.address, group), repeatable=True)


def group_of(addresses: Sequence[int]) -> int:
    """Return the group in which the modules at these addresses move together.

    Others, of another arm or of a part of this one, have another (but for one chance in 127): what
    is sent to these never starts a board that is not watched.
    """
    return FIRST_GROUP + crc32(bytes(sorted(addresses))) % (EVERYONE - FIRST_GROUP)


def start_together(bus: Bus, group: int) -> None:
    """Carry out the buffered trajectories of a group in one servo tick. Nobody answers."""
    bus.send(group, nmc.StartMotion())


def stop_together(bus: Bus, group: int, *, smoothly: bool = True) -> None:
    """Stop a group with one packet and hold. Nobody answers: look at each afterwards.

    It also switches the amplifiers on, so only for a group of modules that are enabled.
    """
    mode = StopMode.SMOOTH if smoothly else StopMode.ABRUPT
    _tell_twice(bus, group, nmc.StopMotor(StopMode.AMPLIFIER | mode))


def release_together(bus: Bus, group: int) -> None:
    """Switch motors and amplifiers of a group off with one packet. Nobody answers."""
    _tell_twice(bus, group, nmc.StopMotor(StopMode.MOTOR_OFF))


def _tell_twice(bus: Bus, group: int, command: nmc.Command) -> None:
    # Nobody confirms, so that one may be lost.
    for _ in range(2):
        bus.send_at_once(group, command)
