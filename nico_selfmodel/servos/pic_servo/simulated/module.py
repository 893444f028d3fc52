"""A simulated PIC-SERVO: registers, motion and faults of one board behind the bus."""

import math
from dataclasses import replace

from nico_selfmodel.servos.pic_servo.protocol import commands as nmc
from nico_selfmodel.servos.pic_servo.protocol.commands import Command, HomingMode, StopMode
from nico_selfmodel.servos.pic_servo.protocol.gains import Gains
from nico_selfmodel.servos.pic_servo.protocol.packets import EVERYONE, UNADDRESSED
from nico_selfmodel.servos.pic_servo.protocol.status import (
    AuxiliaryFlag,
    Status,
    StatusFlag,
    encode_status,
)
from nico_selfmodel.servos.pic_servo.protocol.trajectory import TICK, LoadTrajectory, TrajectoryFlag
from nico_selfmodel.servos.profile import LARGEST_PWM_VELOCITY, Motion, Profile
from nico_selfmodel.servos.simulated.mechanics import SimulatedMechanics

_WRAP = 2**32


class SimulatedModule:
    """One board. Time is whatever the line says; `advance` catches up with it, tick by tick."""

    def __init__(self, device_type: int = 0, version: int = 10, shaft: int = 0) -> None:
        """Power a board up.

        Args:
            device_type: What it answers to be; 0 is a servo.
            version: Of its firmware.
            shaft: Where its motor stands [counts].
        """
        self.device_type, self.version = device_type, version
        self.mechanics = SimulatedMechanics()
        self.motor_power = True
        self.silent = False
        """Hears and obeys, but its replies are lost."""
        self.late_by = 0.0
        """Delay of the next reply [s], once."""
        self.current = 0
        self.restored_address: int | None = None
        """Address that it takes from its configuration memory at power-up."""
        self.shaft = float(shaft)
        self.external = False
        """Whether a plant outside moves the shaft."""
        self._time: float | None = None
        self.power_cycle()

    def power_cycle(self) -> None:
        """Come up anew: no address but a restored one, no torque, position zero."""
        self.address = self.restored_address or UNADDRESSED
        self.group, self.leader = EVERYONE, False
        self.was_addressed = False
        self.baud, self.items, self.output = 19200, 0, 0
        self.gains, self.amplifier = Gains(), False
        self.profile, self.buffered = Profile(), LoadTrajectory(flags=0)
        self.zero, self.home, self.homing = round(self.shaft), 0, 0
        self._sticky, self._aux_sticky = StatusFlag(0), AuxiliaryFlag(0)

    @property
    def position(self) -> int:
        """What the position register holds [counts]."""
        return (math.floor(self.shaft) - self.zero + _WRAP // 2) % _WRAP - _WRAP // 2

    @property
    def servo_on(self) -> bool:
        """Whether the position servo drives the motor."""
        return self.profile.motion not in (Motion.OFF, Motion.PWM)

    @property
    def commanded_shaft(self) -> float | None:
        """Where the servo wants the shaft [counts], None where it does not hold it."""
        return float(self.profile.counts + self.zero) if self.servo_on else None

    def advance(self, time: float) -> None:
        """Carry out the servo ticks up to a time [s]."""
        if self._time is None:
            self._time = time
        tick = TICK * max(1, self.gains.rate_divisor)
        ticks = int((time - self._time) / tick)
        if not ticks:
            return
        self._time += ticks * tick
        for _ in range(ticks):
            if self.profile.at_rest and not self.homing:
                break
            self.profile.tick()
            if self.homing:  # the only thing that looks at every tick
                self._follow()
                self._look_for_home()
        self._follow()

    def _follow(self) -> None:
        """Let the shaft follow the commanded position, unless something holds it or lets go."""
        moving = self.profile.motion != Motion.OFF
        if moving and not (self.motor_power and self.amplifier):
            self._switch_off(StatusFlag(0))
            return
        if not moving or self.external:
            self._check_error()
            return
        if not self.mechanics.stuck:
            wanted = float(self.profile.counts + self.zero)
            low, high = self.mechanics.lower_stop, self.mechanics.upper_stop
            self.shaft = max(low, min(high, wanted))
            if self.profile.motion == Motion.PWM and self.shaft != wanted:
                self.profile.place(round(self.shaft) - self.zero)
        self._check_error()

    def _check_error(self) -> None:
        if self.servo_on and abs(self.position_error) > self.gains.error_limit:
            if self.homing & HomingMode.POSITION_ERROR:
                self._capture_home()
            self._switch_off(StatusFlag.POSITION_ERROR)

    def _switch_off(self, sticky: StatusFlag) -> None:
        self._sticky |= sticky
        self.profile.switch_off()

    @property
    def position_error(self) -> int:
        """Commanded less actual position [counts], 0 where the servo is off."""
        return self.profile.counts - self.position if self.servo_on else 0

    @property
    def limits(self) -> StatusFlag:
        """Levels of the limit inputs; active is high here, on real boards it is not known."""
        flags = StatusFlag(0)
        if self.shaft >= self.mechanics.upper_switch:
            flags |= StatusFlag.LIMIT_1
        if self.shaft <= self.mechanics.lower_switch:
            flags |= StatusFlag.LIMIT_2
        return flags

    def _look_for_home(self) -> None:
        wanted = (HomingMode.LIMIT_1, StatusFlag.LIMIT_1), (HomingMode.LIMIT_2, StatusFlag.LIMIT_2)
        changed = self.limits ^ self._limits_armed
        index = math.floor(self.shaft / self.mechanics.counts_per_index) != self._index_armed
        hit = any(self.homing & mode and changed & flag for mode, flag in wanted)
        if hit or (self.homing & HomingMode.INDEX and index):
            self._capture_home()

    def _capture_home(self) -> None:
        mode, self.homing, self.home = self.homing, 0, self.position
        if mode & HomingMode.OFF:
            self.profile.switch_off()
        elif mode & HomingMode.ABRUPT:
            self.profile.hold()
        elif mode & HomingMode.SMOOTH:
            self.profile.stop_smoothly()

    def overload(self) -> None:
        """Hit the current limit: the driver switches the motor off."""
        if self.homing & HomingMode.OVERCURRENT:
            self._capture_home()
        self._switch_off(StatusFlag.OVERCURRENT)

    def execute(self, command: Command) -> bytes | None:
        """Carry out a command.

        Args:
            command: What was received, undamaged and for this module.

        Returns:
            The reply, or None where there is none.
        """
        handler = getattr(self, f"_do_{type(command).__name__}", None)
        items = command.mode if isinstance(command, nmc.DefineStatus) else self.items
        if handler is not None:
            handler(command)
        if isinstance(command, nmc.HardReset):
            return None
        return self.reply(items)

    def reply(self, items: int | None = None, *, damaged: bool = False) -> bytes:
        """Return a status packet.

        Args:
            items: Which items; those of the status mask if omitted.
            damaged: Whether the command just received was damaged.
        """
        items = self.items if items is None else items
        status = self.status()
        if damaged:
            status = replace(status, flags=status.flags | StatusFlag.CHECKSUM_ERROR)
        return encode_status(items, status)

    def status(self) -> Status:
        """Return everything that a reply can say."""
        flags = self._sticky | self.limits
        flags |= StatusFlag.MOVE_DONE if self.profile.move_done else StatusFlag(0)
        flags |= StatusFlag.POWER_ON if self.motor_power else StatusFlag(0)
        flags |= StatusFlag(0) if self.servo_on else StatusFlag.POSITION_ERROR
        flags |= StatusFlag.HOMING if self.homing else StatusFlag(0)
        auxiliary = self._aux_sticky | (AuxiliaryFlag.SERVO_ON if self.servo_on else 0)
        error = max(-32768, min(32767, self.position_error))
        return Status(
            flags=flags,
            position=self.position,
            current=self.current,
            velocity=max(-32768, min(32767, self.profile.velocity >> 16)),
            auxiliary=auxiliary,
            home=self.home,
            device_type=self.device_type,
            device_version=self.version,
            position_error=error,
            path_points=0,
        )

    def _do_ResetPosition(self, command: nmc.ResetPosition) -> None:
        offset = self.position if command.mode == 0 else 0
        if command.mode & nmc.ResetMode.RELATIVE_TO_HOME:
            offset = self.home
        if command.mode & nmc.ResetMode.SET_POSITION and command.position is not None:
            offset = self.position - command.position
        self.zero += offset
        if self.profile.motion == Motion.TRAPEZOID:
            self.profile.hold()
        # The commanded position follows the actual one, so that nothing jumps.
        self.profile.place(self.position)

    def _do_SetAddress(self, command: nmc.SetAddress) -> None:
        self.address, self.group, self.leader = command.address, command.group, command.leader
        self.was_addressed = True

    def _do_DefineStatus(self, command: nmc.DefineStatus) -> None:
        self.items = command.mode

    def _do_LoadTrajectory(self, command: LoadTrajectory) -> None:
        last = self.buffered
        kept = {
            name: getattr(last if getattr(command, name) is None else command, name)
            for name in ("position", "velocity", "acceleration", "pwm")
        }
        relative = command.flags & TrajectoryFlag.REVERSE and not (
            command.flags & TrajectoryFlag.VELOCITY_MODE
        )
        if command.position is not None and self.profile.motion == Motion.TRAPEZOID:
            # Before version 10 a goal that comes during a move is an offset.
            relative = relative or self.version < 10
        if command.position is not None and relative:
            kept["position"] = (self.profile.goal >> 16) + command.position
        self.buffered = LoadTrajectory(flags=command.flags, **kept)
        if command.flags & TrajectoryFlag.START_NOW:
            self._start()

    def _do_StartMotion(self, command: nmc.StartMotion) -> None:
        self._start()

    def _start(self) -> None:
        load, profile = self.buffered, self.profile
        backwards = bool(load.flags & TrajectoryFlag.REVERSE)
        if not (self.motor_power and self.amplifier):
            return
        if not load.flags & TrajectoryFlag.SERVO:
            profile.place(self.position)
            speed = LARGEST_PWM_VELOCITY * (load.pwm or 0) // 255
            profile.motion, profile.velocity = Motion.PWM, -speed if backwards else speed
            return
        if not self.servo_on:
            profile.place(self.position)
            profile.velocity = 0
        profile.acceleration = max(1, load.acceleration or 1)
        speed = load.velocity or 0
        if load.flags & TrajectoryFlag.VELOCITY_MODE:
            profile.motion = Motion.VELOCITY
            profile.target_velocity = -speed if backwards else speed
        elif load.position is not None:
            profile.motion, profile.target_velocity = Motion.TRAPEZOID, speed
            profile.goal = load.position << 16

    def _do_SetGain(self, command: nmc.SetGain) -> None:
        self.gains = command.gains

    def _do_StopMotor(self, command: nmc.StopMotor) -> None:
        mode, profile = command.mode, self.profile
        self.amplifier = bool(mode & StopMode.AMPLIFIER)
        if mode & StopMode.MOTOR_OFF:
            profile.switch_off()
            return
        if not (self.amplifier and self.motor_power):
            profile.switch_off()
            return
        if mode & (StopMode.ABRUPT | StopMode.HERE | StopMode.SMOOTH) and not self.servo_on:
            profile.place(self.position)
            profile.velocity = 0
        if mode & StopMode.SMOOTH:
            profile.stop_smoothly()
        elif mode & StopMode.HERE and command.position is not None:
            profile.hold()
            profile.place(command.position)
        elif mode & StopMode.ABRUPT:
            profile.hold()

    def _do_IoControl(self, command: nmc.IoControl) -> None:
        self.output = command.mode

    def _do_SetHoming(self, command: nmc.SetHoming) -> None:
        self.homing = command.mode
        self._limits_armed = self.limits
        self._index_armed = math.floor(self.shaft / self.mechanics.counts_per_index)

    def _do_SetBaud(self, command: nmc.SetBaud) -> None:
        self.baud = nmc.BAUD_OF_CODE.get(command.mode, self.baud)

    def _do_ClearBits(self, command: nmc.ClearBits) -> None:
        self._sticky, self._aux_sticky = StatusFlag(0), AuxiliaryFlag(0)

    def _do_SaveHome(self, command: nmc.SaveHome) -> None:
        self.home = self.position

    def _do_PathPoints(self, command: nmc.PathPoints) -> None:
        """Follow no path: nothing here sends one."""

    def _do_HardReset(self, command: nmc.HardReset) -> None:
        self.power_cycle()
