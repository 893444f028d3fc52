"""Which board is which joint: addresses along the chain, rates that a board missed."""

from dataclasses import replace

import pytest

from nico_selfmodel.errors import BusError
from nico_selfmodel.servos import ArmController
from nico_selfmodel.servos.pic_servo.joint_bus import PicServoJointBus
from nico_selfmodel.servos.pic_servo.line.chain import scan
from nico_selfmodel.servos.pic_servo.simulated.module import SimulatedModule

from .arms import virtual_arm


def boards(n):
    return [SimulatedModule() for _ in range(n)]


def arm_with(modules, addresses, **options):
    """Return an arm whose joints have these addresses, in this order."""
    made = virtual_arm(modules, joints=[f"joint_{k}" for k in addresses], **options)
    config = made.arm.config
    joints = [replace(j, address=a) for j, a in zip(config.joints, addresses, strict=True)]
    config = replace(config, joints=tuple(joints))
    made.arm = ArmController(PicServoJointBus(made.bus, config), config, trust_zero=True)
    return made


def addresses(made):
    return [module.address for module in made.modules]


def test_addresses_follow_the_order_of_the_configuration():
    made = arm_with(boards(3), (3, 1, 2))
    made.arm.connect()
    assert addresses(made) == [3, 1, 2]
    made.arm.enable(["joint_3"])
    assert [module.servo_on for module in made.modules] == [True, False, False]


@pytest.mark.parametrize("part", [(4, 5, 6), (1, 2, 3), (1, 2, 3, 4, 5)])
def test_a_configuration_of_a_part_numbers_no_chain(part):
    """Its first board would be taken for the fourth, and the next program would believe it."""
    made = arm_with(boards(6), part)
    for _ in range(2):
        with pytest.raises(BusError, match=r"without an address waits behind .*whole chain"):
            made.arm.connect()
        assert addresses(made) == [0] * 6
    whole = arm_with(made.modules, (1, 2, 3, 4, 5, 6))
    whole.arm.connect()
    assert addresses(whole) == [1, 2, 3, 4, 5, 6]
    again = arm_with(whole.modules, part)
    again.arm.connect()  # where all have their addresses a part is enough


def test_a_board_more_than_the_configuration_has_is_noticed_later_too():
    made = arm_with(boards(6), (1, 2, 3, 4, 5))
    scan(made.bus, [1, 2, 3, 4, 5])
    with pytest.raises(BusError, match="without an address waits behind the 5"):
        made.arm.connect()
    assert addresses(made) == [1, 2, 3, 4, 5, 0]


@pytest.mark.parametrize("there", [[4, 5, 6], [3, 4, 5, 6], [2, 3, 4, 5, 6]])
def test_a_new_board_before_boards_that_have_addresses_is_refused(there):
    modules = boards(6)
    scan(virtual_arm(modules).bus, there)
    made = arm_with(modules, (1, 2, 3, 4, 5, 6))
    with pytest.raises(BusError, match=r"may be another than module 1, .* off and on"):
        made.arm.connect()
    assert addresses(made) == [*there, *[0] * (6 - len(there))]


@pytest.mark.parametrize("when", ["now", "earlier"])
def test_a_board_that_missed_the_change_of_rate_is_fetched(when):
    made = arm_with(boards(4), (1, 2, 3, 4), baud=115200)
    deaf = made.modules[2]
    original, count = deaf._do_SetBaud, [0]

    def miss(command):
        count[0] += 1
        if count[0] > 1:
            original(command)

    deaf._do_SetBaud = miss
    if when == "earlier":
        arm_with(made.modules, (1, 2, 3, 4), baud=57600).arm.connect()
        deaf.baud, count[0] = 19200, 1
        for module in (made.modules[0], made.modules[1], made.modules[3]):
            module.baud = 115200
    made.arm.connect()
    assert [module.baud for module in made.modules] == [115200] * 4
    assert made.bus.rate == 115200
    assert count[0] == 2
    made.arm.enable()


def test_a_board_that_was_reset_alone_gets_its_address_back():
    """Until it has one those behind it do not answer either."""
    made = arm_with(boards(4), (1, 2, 3, 4))
    made.arm.connect()
    made.arm.enable()
    made.modules[1].power_cycle()
    assert made.arm.connect() == ("joint_1", "joint_2", "joint_3", "joint_4")
    assert addresses(made) == [1, 2, 3, 4]
    assert made.arm.cycle().enabled.tolist() == [True, False, True, True]
