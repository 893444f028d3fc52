"""Finding the boards of a configuration, without moving or resetting any."""

from collections.abc import Sequence

from nico_selfmodel.errors import BusError
from nico_selfmodel.servos.arm.servo_config import ServoConfig
from nico_selfmodel.servos.pic_servo.line.board import FIRST_SC_VERSION, SERVO_TYPE, PicServo
from nico_selfmodel.servos.pic_servo.line.bus import Bus
from nico_selfmodel.servos.pic_servo.line.chain import FoundModule, join_group, scan
from nico_selfmodel.servos.pic_servo.protocol.packets import EVERYONE

POWER_UP_RATE = 19200
_OTHER_RATES = (115200, 57600)


def find_modules(bus: Bus, config: ServoConfig) -> list[FoundModule]:
    """Find every module of a configuration, at whatever rate, and bring all to its rate.

    Modules without an address get theirs in the order of the configuration, which must be the
    order of the chain. Nothing is reset, so that no zero is lost.

    Raises:
        BusError: If a module is missing, is no servo or is too old; says which and what to do.
    """
    wanted = sorted(joint.address for joint in config.joints)
    # A busy host may miss a reply: before a module is called missing it is asked again.
    found = _look_everywhere(bus, config, wanted, 2) or _look_everywhere(bus, config, wanted, 4)
    if found and len(found) < len(wanted):
        found = scan(bus, wanted, attempts=4) or found
    _check_complete(bus, config, found)
    _check_types(config, found)
    if bus.rate != config.baud:
        _change_rate(bus, config.baud, wanted)
    return found


def _look_everywhere(
    bus: Bus, config: ServoConfig, wanted: Sequence[int], attempts: int
) -> list[FoundModule]:
    """Return what answers at the first rate at which anything does."""
    for rate in dict.fromkeys((config.baud, POWER_UP_RATE, *_OTHER_RATES)):
        if bus.rate != rate:
            bus.port.set_rate(rate)
            bus.resynchronise()
        if found := scan(bus, wanted, attempts=attempts):
            return found
    return []


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


def _change_rate(bus: Bus, rate: int, addresses: Sequence[int]) -> None:
    # Only the group of everyone hears the change; a module may be in the group of an enabled arm.
    for address in addresses:
        module = PicServo(bus, address)
        module.watch()
        join_group(module, EVERYONE)
    bus.change_rate(rate, list(addresses))
