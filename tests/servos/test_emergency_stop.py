"""The emergency stop, and what else ails several joints at once: who is switched off, who holds."""

import pytest

from nico_selfmodel.errors import BusError, ServoFault
from nico_selfmodel.servos.arm.shutdown import stop_unseen
from nico_selfmodel.servos.ports import PortLostError

from ..slow_rest import slow_rest
from .arms import JOINTS, MAKES, drive, virtual_arm


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


def babble(made):
    """Let the receive line never become quiet; the boards hear all the same."""
    port = made.port

    def read(count, timeout):
        port.sleep(1e-3)
        return b"\x55" * count

    port.read = read


def moving_arm(**options):
    made = virtual_arm(**options)
    made.arm.connect()
    made.arm.enable()
    made.arm.move(dict.fromkeys(JOINTS, 1.5))
    go_on(made, 4)
    return made


def seconds_until(made, done):
    """Return how long after now something is true that the modules show."""
    begin, sleep = made.port.time, made.port.sleep
    when = []

    def watched(seconds):
        sleep(seconds)
        if not when and done():
            when.append(made.port.time - begin)

    made.port.sleep = watched
    return when


@pytest.mark.parametrize("make", MAKES[:1])
def test_a_stop_does_not_wait_for_the_receive_line_to_become_quiet(make):
    made = moving_arm(make=make)
    babble(made)
    begin = made.port.time
    stopped = seconds_until(made, lambda: not any(m.profile.velocity for m in made.modules))
    with pytest.raises(BusError, match=r"never gets quiet.*none could confirm"):
        made.arm.stop()
    assert made.port.time - begin < 1.5
    assert stopped[0] < 0.35
    assert held(made) == [True] * 6


@pytest.mark.parametrize("joints", [None, ["right_elbow", "right_wrist"]])
def test_a_release_does_not_wait_for_the_receive_line_to_become_quiet(joints):
    made = moving_arm()
    babble(made)
    off = [joints is None or name in joints for name in JOINTS]
    released = seconds_until(made, lambda: held(made) == [not switched for switched in off])
    with pytest.raises(BusError, match="never gets quiet"):
        made.arm.release(joints)
    assert released[0] < 0.2


@pytest.mark.parametrize("release", [False, True])
def test_a_silent_arm_is_stopped_all_the_same(release):
    made = moving_arm()
    drive(made.modules[3], velocity=1_000_000, acceleration=70_000)
    made.port.sleep(0.3)
    for module in made.modules:
        module.silent = True
    again = virtual_arm(made.modules)
    again.port.time, again.port.rate = made.port.time, 19200
    stop_unseen(again.arm.bus, again.arm.axes, release=release)
    assert again.port.time - made.port.time < 1.0
    assert held(again) == [not release] * 6
    at = again.shafts()
    again.port.sleep(1.0)
    assert again.shafts() == at


def test_before_anybody_is_looked_for_no_board_that_is_off_is_told_to_hold(virtual):
    for module in virtual.modules[:3]:
        module.overload()  # and the program dies: they are in the group still
    virtual.modules[5].silent = True
    again = virtual_arm(virtual.modules)
    again.port.time = virtual.port.time
    stop_unseen(again.arm.bus, again.arm.axes, release=False)
    assert held(again) == [False] * 3 + [True] * 3


def test_a_stop_that_is_interrupted_leaves_something_to_stop(virtual, monkeypatch):
    """Ctrl-C in an exchange, and again in the stop that it causes."""
    virtual.arm.move(dict.fromkeys(JOINTS, 1.5))
    go_on(virtual, 4)
    virtual.bus._doubtful = True

    def interrupt(seconds):
        raise KeyboardInterrupt

    told = commands_to_hold(virtual)
    with monkeypatch.context() as interrupted:
        interrupted.setattr(virtual.port, "read", lambda count, timeout: interrupt(0.0))
        interrupted.setattr(virtual.port, "sleep", interrupt)
        with pytest.raises(KeyboardInterrupt):
            virtual.arm.stop()
    assert virtual.arm.moving
    virtual.port.sleep(0.05)
    assert sorted(set(told)) == [1, 2, 3, 4, 5, 6]  # the first stop was written before all else
    virtual.arm.close()
    assert virtual.seconds_to_rest() < 0.3
    assert not virtual.arm.moving


@pytest.mark.parametrize("make", slow_rest(MAKES[1:]))
def test_servos_on_a_noisy_line_are_told_to_stop_all_the_same(make):
    made = moving_arm(make=make)
    made.bus._doubtful = True
    babble(made)
    written, original = [], made.port.write
    made.port.write = lambda data: (written.append(bytes(data)), original(data))
    with pytest.raises(BusError, match="never gets quiet"):
        made.arm.stop()
    assert written
    with pytest.raises(BusError, match="never gets quiet"):
        made.arm.release()
    made.port.sleep(0.1)
    assert held(made) == [False] * 6


@pytest.mark.parametrize("how", ["stop", "release", "silence"])
def test_a_port_that_is_gone_is_named_by_a_stop_and_not_every_joint(any_arm, how):
    arm = any_arm.arm
    arm.move(dict.fromkeys(JOINTS, 0.3))
    go_on(any_arm, 2)
    any_arm.port.unplugged = True
    if how == "silence":  # the host was late, and the cycle stops the arm
        arm._alive = -1e9
    with pytest.raises(PortLostError, match=r"The arm stops by itself") as caught:
        {"stop": arm.stop, "release": arm.release, "silence": arm.cycle}[how]()
    assert "module" not in str(caught.value)
    with pytest.raises(BusError, match="not connected"):
        arm.stop()
