"""Finding the boards of a configuration, without moving or resetting any."""

from collections.abc import Sequence

from nico_selfmodel.errors import BusError
from nico_selfmodel.servos.arm.servo_config import ServoConfig
from nico_selfmodel.servos.pic_servo.line.board import (
    FIRST_SC_VERSION,
    LAST_SC_VERSION,
    SERVO_TYPE,
    PicServo,
)
from nico_selfmodel.servos.pic_servo.line.bus import Bus
from nico_selfmodel.servos.pic_servo.line.chain import FoundModule, anybody, join_group, scan
from nico_selfmodel.servos.pic_servo.protocol.packets import EVERYONE

POWER_UP_RATE = 19200
_OTHER_RATES = (115200, 57600)


def find_modules(bus: Bus, config: ServoConfig) -> list[FoundModule]:
    """Find every module of a configuration, at whatever rate, and bring all to its rate.

    Modules without an address get theirs in the order of the configuration, which must be the
    order of the chain. Nothing that has a zero is reset.

    Raises:
        BusError: If a module is missing, is no servo, of an unknown version, or more than the
            configuration has; says which and what to do.
    """
    wanted = [joint.address for joint in config.joints]
    # A busy host may miss a reply: before a module is called missing it is asked again.
    found = _look_everywhere(bus, config, wanted, 2) or _look_everywhere(bus, config, wanted, 4)
    if found and len(found) < len(wanted):
        found = scan(bus, wanted, attempts=4, whole=True) or found
    if found and len(found) < len(wanted) and _fetch(bus, config, _absent(wanted, found)):
        found = scan(bus, wanted, attempts=4, whole=True) or found
    _check_complete(bus, config, found)
    _check_types(config, found)
    if bus.rate != config.baud:
        _change_rate(bus, config, wanted)
    return found


def _rates(config: ServoConfig) -> Sequence[int]:
    return list(dict.fromkeys((config.baud, POWER_UP_RATE, *_OTHER_RATES)))


def _absent(wanted: Sequence[int], found: Sequence[FoundModule]) -> list[int]:
    here = {module.address for module in found}
    return [address for address in wanted if address not in here]


def _look_everywhere(
    bus: Bus, config: ServoConfig, wanted: Sequence[int], attempts: int
) -> list[FoundModule]:
    """Return what answers at the first rate at which anything does."""
    for rate in _rates(config):
        _listen_at(bus, rate)
        if found := scan(bus, wanted, attempts=attempts, whole=True):
            return found
    return []


def _listen_at(bus: Bus, rate: int) -> None:
    if bus.rate != rate:
        bus.port.set_rate(rate)
        bus.resynchronise()


def _fetch(bus: Bus, config: ServoConfig, missing: Sequence[int]) -> bool:
    """Bring modules to the rate of the others that missed a change of it, as nobody confirms one.

    Returns:
        Whether there were any.
    """
    rate, fetched = bus.rate, False
    for other in _rates(config):
        if other == rate:
            continue
        _listen_at(bus, other)
        here = [address for address in missing if anybody(bus, address) is not None]
        if here:
            fetched = True
            _tell_rate(bus, rate, here)
    _listen_at(bus, rate)
    return fetched


def _check_complete(bus: Bus, config: ServoConfig, found: Sequence[FoundModule]) -> None:
    here = {module.address for module in found}
    missing = [joint for joint in config.joints if joint.address not in here]
    if not missing:
        return
    names = ", ".join(f"{joint.name} (module {joint.address})" for joint in missing)
    if not here:
        raise BusError(
            f"no module answers on {bus.port.name}: are the boards switched on, is the adapter's "
            "RS485 side connected to the first one?"
        )
    raise BusError(
        f"{len(here)} of {len(config.joints)} modules answer; missing: {names}. Check power and "
        "cable behind the last one that answers; two modules may also share an address, or one "
        "was switched off alone: then support the arm, switch all boards off and on, and home "
        "it again"
    )


def _check_types(config: ServoConfig, found: Sequence[FoundModule]) -> None:
    by_address = {module.address: module for module in found}
    for joint in config.joints:
        device = by_address[joint.address].device
        if device.type != SERVO_TYPE:
            raise BusError(
                f"module {joint.address} is a {device}, but {joint.name} needs a PIC-SERVO: "
                "correct its 'address' in the servo configuration"
            )
        if device.version < FIRST_SC_VERSION:
            raise BusError(
                f"module {joint.address} ({joint.name}) is a {device}: goals that move on need "
                f"version {FIRST_SC_VERSION} or later; this board cannot be driven safely"
            )
        if device.version > LAST_SC_VERSION:
            raise BusError(
                f"module {joint.address} ({joint.name}) is a {device}: what its output modes mean "
                f"is known of versions {FIRST_SC_VERSION} to {LAST_SC_VERSION}, and a wrong one "
                "can damage its amplifier; this board cannot be driven safely"
            )


def _change_rate(bus: Bus, config: ServoConfig, addresses: Sequence[int]) -> None:
    """Bring all modules to the rate of the configuration, also one that missed it.

    Raises:
        NoReplyError: If one does not follow.
    """
    _tell_rate(bus, config.baud, addresses)
    missing = [address for address in addresses if anybody(bus, address) is None]
    if missing:
        _fetch(bus, config, missing)
    for address in missing:
        PicServo(bus, address).identify()


def _tell_rate(bus: Bus, rate: int, addresses: Sequence[int]) -> None:
    # Only the group of everyone hears the change; a module may be in the group of an enabled arm.
    for address in addresses:
        module = PicServo(bus, address)
        module.watch()
        join_group(module, EVERYONE)
    bus.change_rate(rate, [])
