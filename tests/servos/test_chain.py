"""Who is there: addresses along the chain, and everything that can be wrong with it."""

import pytest

from nico_selfmodel.errors import BusError
from nico_selfmodel.servos.pic_servo.line.board import PicServo
from nico_selfmodel.servos.pic_servo.line.bus import Bus, UncertainError
from nico_selfmodel.servos.pic_servo.line.chain import join_group, scan
from nico_selfmodel.servos.pic_servo.protocol.commands import HardReset
from nico_selfmodel.servos.pic_servo.protocol.packets import EVERYONE
from nico_selfmodel.servos.pic_servo.simulated.line import PicServoLine
from nico_selfmodel.servos.pic_servo.simulated.module import SimulatedModule
from nico_selfmodel.servos.simulated.port import SimulatedPort


def bus_of(*modules):
    return Bus(SimulatedPort(PicServoLine(modules)))


def boards(n):
    return [SimulatedModule() for _ in range(n)]


def test_new_modules_get_their_addresses_in_the_order_of_the_chain():
    modules = boards(6)
    found = scan(bus_of(*modules))
    assert [f.address for f in found] == [1, 2, 3, 4, 5, 6] == [m.address for m in modules]
    assert all(f.newly_addressed and str(f.device) == "PIC-SERVO version 10" for f in found)
    assert not any(f.servo_on or f.zero_known for f in found)


def test_a_second_scan_finds_the_same_and_changes_nothing():
    modules = boards(3)
    bus = bus_of(*modules)
    scan(bus)
    modules[1].shaft = 500.0
    found = scan(bus)
    assert [f.address for f in found] == [1, 2, 3]
    assert not any(f.newly_addressed for f in found)
    assert found[1].status.position == 500


def test_a_chosen_set_of_addresses_is_given_in_its_order():
    modules = boards(2)
    assert [f.address for f in scan(bus_of(*modules), [7, 4])] == [4, 7]
    assert [m.address for m in modules] == [7, 4]


def test_a_module_with_an_address_of_its_own_is_found_and_not_given_another():
    modules = boards(2)
    modules[1].restored_address = 1
    modules[1].power_cycle()
    found = scan(bus_of(*modules))
    assert [(f.address, f.newly_addressed) for f in found] == [(1, False), (2, True)]
    assert [m.address for m in modules] == [2, 1]


def test_behind_a_cut_line_nobody_is_found():
    bus = bus_of(*boards(5))
    bus.port.line.broken_after = 2
    assert [f.address for f in scan(bus)] == [1, 2]


def test_an_empty_bus_has_no_modules():
    assert scan(bus_of()) == []


@pytest.mark.parametrize(("versions", "places"), [((10, 13), (0, 0)), ((10, 10), (0, 900))])
def test_two_modules_on_one_address_are_called_that(versions, places):
    modules = [SimulatedModule(version=version) for version in versions]
    for module, place in zip(modules, places, strict=True):
        module.restored_address = 3
        module.power_cycle()
        module.shaft = place
    with pytest.raises(BusError, match="address 3 answers, but every reply is damaged: two mod"):
        scan(bus_of(*modules))


def test_a_lost_reply_to_a_new_address_does_not_give_it_to_two():
    modules = boards(3)
    bus = bus_of(*modules)
    original, lost = modules[0].execute, []

    def lose_first_address(command):
        reply = original(command)
        if type(command).__name__ == "SetAddress" and not lost:
            lost.append(command)
            return None
        return reply

    modules[0].execute = lose_first_address
    assert [f.address for f in scan(bus)] == [1, 2, 3]
    assert [m.address for m in modules] == [1, 2, 3]
    assert len(lost) == 1


def test_a_module_that_will_not_take_its_address_is_an_error():
    module = SimulatedModule()
    bus = bus_of(module)
    original = module.execute
    module.execute = lambda c: None if type(c).__name__ == "SetAddress" else original(c)
    with pytest.raises(BusError, match="module 1 of the chain could not be given its address") as e:
        scan(bus)
    assert isinstance(e.value.__cause__, UncertainError)


def test_a_hard_reset_loses_addresses_positions_and_torque():
    modules = boards(2)
    bus = bus_of(*modules)
    scan(bus)
    modules[0].shaft = 400.0
    bus.change_rate(115200, [1, 2])
    join_group(PicServo(bus, 1), 0x80)
    bus.send(EVERYONE, HardReset())
    bus.wait(0.1)
    assert [m.address for m in modules] == [0, 0]
    bus.port.set_rate(19200)
    found = scan(bus)
    assert [f.newly_addressed for f in found] == [True, True]
    assert found[0].status.position == 0


def test_a_module_that_was_slow_to_answer_does_not_share_its_address():
    modules = boards(3)
    bus = bus_of(*modules)
    scan(bus, [1, 2])
    modules[0].silent = True
    answers, original = [], bus.port.line._answer

    def answer(module, packet):
        answers.append(packet)
        modules[0].silent = len(answers) < 5  # it misses the first look
        return original(module, packet)

    bus.port.line._answer = answer
    found = scan(bus, [1, 2, 3])
    assert [m.address for m in modules] == [1, 2, 3]
    assert [(f.address, f.newly_addressed) for f in found] == [(1, False), (2, False), (3, True)]
