"""The emergency stop, and what else ails several joints at once: who is switched off, who holds."""

import pytest

from nico_selfmodel.errors import BusError, ServoFault

from ..slow_rest import slow_rest
from .arms import JOINTS, MAKES, virtual_arm


@pytest.fixture(params=slow_rest(MAKES, plain=1))
def any_arm(request):
    """Return an arm of each make in virtual time: connected, enabled, its zero trusted."""
    made = virtual_arm(make=request.param)
    made.arm.connect()
    made.arm.enable()
    return made


def go_on(made, cycles):
    for _ in range(cycles):
        made.arm.heartbeat()
        made.arm.cycle()


def held(made):
    return [module.servo_on for module in made.modules]


def commands_to_hold(made):
    """Return the list to which the addresses of boards go that are told to stop and hold."""
    told = []
    for module in made.modules:
        original = module.execute

        def execute(command, module=module, original=original):
            if type(command).__name__ == "StopMotor" and command.mode & 1:
                told.append(module.address)
            return original(command)

        module.execute = execute
    return told


def test_after_an_emergency_stop_no_board_is_told_to_hold(virtual):
    virtual.arm.move(dict.fromkeys(JOINTS, 1.2))
    go_on(virtual, 4)
    for module in virtual.modules:
        module.motor_power = False
    told = commands_to_hold(virtual)
    with pytest.raises(
        ServoFault, match=r"no motor power.*Switched off too, by faults of their own"
    ):
        virtual.arm.cycle()
    assert told == []
    assert not any(module.amplifier for module in virtual.modules)
    state = virtual.arm.cycle()
    assert not state.enabled.any()
    assert all("no motor power" in trouble for trouble in state.trouble)
    for module in virtual.modules:
        module.motor_power = True
    before = virtual.shafts()
    virtual.port.sleep(1.0)
    assert virtual.shafts() == before
    assert not any(held(virtual))
    virtual.arm.enable()  # somebody has to say so
    virtual.arm.move({"right_elbow": 0.1})
    virtual.cycle_until_there()


def test_of_joints_that_trip_at_once_none_is_switched_on_by_the_stop_of_the_others(any_arm):
    any_arm.arm.move(dict.fromkeys(JOINTS, 0.8))
    go_on(any_arm, 4)
    any_arm.modules[0].overload()
    any_arm.modules[3].overload()
    any_arm.modules[5].overload()
    words = "right_shoulder_pitch.*faults of their own: right_elbow, right_wrist. The other joints"
    with pytest.raises(ServoFault, match=words):
        go_on(any_arm, 2)
    assert any_arm.seconds_to_rest() < 0.5
    assert held(any_arm) == [False, True, True, False, True, False]
    state = any_arm.arm.cycle()
    assert state.enabled.tolist() == held(any_arm)
    assert state.trouble[3] is not None
    assert state.trouble[4] is None


def test_a_fault_that_a_stop_finds_is_switched_off_and_told(any_arm):
    any_arm.arm.move(dict.fromkeys(JOINTS, 0.8))
    go_on(any_arm, 4)
    any_arm.modules[3].overload()
    with pytest.raises(BusError, match=r"right_elbow .*enable it again"):
        any_arm.arm.stop()
    assert held(any_arm) == [True, True, True, False, True, True]
    assert any_arm.arm.cycle().enabled.tolist() == held(any_arm)


def test_a_silent_board_does_not_hide_the_fault_of_another(virtual):
    virtual.arm.move(dict.fromkeys(JOINTS, 0.8))
    go_on(virtual, 4)
    virtual.modules[1].silent = True
    virtual.modules[4].overload()
    with pytest.raises(BusError, match=r"right_shoulder_roll.*is lost.*right_forearm_twist"):
        virtual.arm.cycle()
    assert not virtual.modules[4].servo_on
    assert virtual.seconds_to_rest() < 0.5
