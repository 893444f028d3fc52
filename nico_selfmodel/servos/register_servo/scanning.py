"""Finding servos with registers on a port, at whatever rate and id."""

from collections.abc import Sequence

from nico_selfmodel.servos.bus_settings import NoReplyError
from nico_selfmodel.servos.found_motor import FoundMotor, Scan
from nico_selfmodel.servos.makes import Make
from nico_selfmodel.servos.register_servo.joint_bus import RegisterJointBus, model_of
from nico_selfmodel.servos.register_servo.register_bus import RegisterBus

_ATTEMPTS = 2


def scan_servos(
    bus: RegisterBus, kind: type[RegisterJointBus], make: Make, rates: Sequence[int], last: int
) -> Scan:
    """Return the servos that answer at the first rate at which any does. Moves and changes nothing.

    Args:
        bus: An open bus.
        kind: Of the servos' buses.
        make: Theirs.
        rates: Where to look [baud].
        last: Highest id to look at.

    Raises:
        BusError: If two servos have one id.
    """
    first, highest = make.addresses
    ids = range(first, min(last, highest) + 1)
    for rate in rates:
        if bus.port.rate != rate:
            bus.port.set_rate(rate)
        found = [servo for n in ids if (servo := _servo(bus, kind, n)) is not None]
        if found:
            return Scan(rate, tuple(found), bus.total())
    return Scan(bus.port.rate, (), bus.total())


def _servo(bus: RegisterBus, kind: type[RegisterJointBus], address: int) -> FoundMotor | None:
    motor = kind.motor_type
    try:
        bus.read(address, kind.model_register, 2, attempts=_ATTEMPTS)
    except NoReplyError:
        if not bus.counts[address].damaged:
            return None
    model = model_of(bus, address, kind.model_register, motor.block)
    position = bus.read(address, *motor.position).data
    on = bus.read(address, motor.torque_register, 1).data[0]
    name = kind.models.get(model, f"model {model}")
    return FoundMotor(address, name, motor.number(position), bool(on), True, False)
