"""Which motor drives which joint, and what it may do: the servo configuration."""

import math
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.dataset.joint_info import JointInfo
from nico_selfmodel.model.arm.servo_map import ServoMap
from nico_selfmodel.servos.makes import PIC_SERVO, Make
from nico_selfmodel.servos.pic_servo.protocol.commands import OutputMode
from nico_selfmodel.servos.pic_servo.protocol.gains import Gains
from nico_selfmodel.servos.pic_servo.protocol.trajectory import (
    acceleration_step,
    acceleration_units,
    velocity_units,
)

LONGEST_STOP = 0.5
"""Bound on the time from the end of the heartbeat to standstill [s]."""
_COARSE = 0.01
"""Share of the largest acceleration above which a board's unit of it counts."""
HOME_METHODS = ("here", "limit_1", "limit_2", "index")
OUTPUTS = {"one_pwm": 0, "three_phase": int(OutputMode.THREE_PHASE)}


@dataclass(frozen=True)
class HomePlan:
    """How a joint finds its zero after the power was off."""

    method: str = "here"
    """`here`: a person puts the joint at its home; else what marks home on the way to it."""
    at: float = 0.0
    """Encoder angle at home [rad]."""
    speed: float = 0.0
    """Which way and how fast to look for the mark [rad/s]."""
    travel: float = 0.0
    """How far to look at most [rad]."""


@dataclass(frozen=True)
class JointServo:
    """A joint and its motor. Angles are the encoder's: `sign * (register - zero_counts)`, in turns.

    Raises:
        ValueError: If a value is not valid; names it as the file does.
    """

    name: str
    address: int
    """Of the board, or the servo's id."""
    counts_per_turn: float
    """Counts of a turn of the joint: encoder lines, times four, times the gearhead."""
    lower: float
    """Lowest angle that may be commanded [rad]."""
    upper: float
    """Highest angle that may be commanded [rad]."""
    max_velocity: float
    """[rad/s]."""
    max_acceleration: float
    """[rad/s^2]."""
    sign: int = 1
    """-1 where the motor counts down as the reading goes up."""
    output: str = "three_phase"
    """What kind of amplifier a PIC-SERVO has: `three_phase` or `one_pwm`."""
    gains: Gains = field(default_factory=Gains)
    """Of a PIC-SERVO's position loop."""
    home: HomePlan = field(default_factory=HomePlan)
    make: Make = PIC_SERVO
    zero_counts: int | None = None
    """Register at the encoder's zero; the make's if None."""
    homing_offset: int | None = None
    """What a servo's own register of that name must hold for its zero to be known; any if None."""

    def __post_init__(self) -> None:
        """Check the values."""
        if not self.name.strip():
            raise ValueError("'name' must not be empty")
        first, last = self.make.addresses
        if not first <= self.address <= last:
            raise ValueError(f"'address' must be {first} to {last}, got {self.address}")
        if self.sign not in (1, -1):
            raise ValueError(f"'sign' must be 1 or -1, got {self.sign}")
        if not self.counts_per_turn > 0.0:
            raise ValueError(f"'counts_per_turn' must be positive, got {self.counts_per_turn}")
        if self.output not in OUTPUTS:
            raise ValueError(f"'output' must be one of {', '.join(OUTPUTS)}, got {self.output!r}")
        self.gains.check()
        self._check_zero()
        self._check_motion()
        self._check_home()

    def __str__(self) -> str:
        return f"{self.name} ({self.make.unit} {self.address})"

    def _check_zero(self) -> None:
        if self.zero_counts is None:
            object.__setattr__(self, "zero_counts", self.make.zero_counts)
        elif not self.make.keeps_zero and self.zero_counts:
            raise ValueError(
                "'zero_counts' is for servos that keep their zero: home a board instead"
            )
        if not self.make.keeps_zero and self.homing_offset is not None:
            raise ValueError("'homing_offset' is for servos that keep their zero")

    def _check_motion(self) -> None:
        if not self.lower < self.upper:
            raise ValueError(
                f"'lower_deg' must be less than 'upper_deg', got {math.degrees(self.lower):g} and "
                f"{math.degrees(self.upper):g}"
            )
        first, last = self.make.registers
        ends = (self.register(self.lower_reading), self.register(self.upper_reading))
        if min(ends) < first or max(ends) > last:
            raise ValueError(
                f"the limits do not fit the position register: they are {min(ends)} to {max(ends)} "
                f"counts, it holds {first} to {last}"
            )
        if not (self.max_velocity > 0.0 and self.max_acceleration > 0.0):
            raise ValueError("'max_velocity_deg_s' and 'max_acceleration_deg_s2' must be positive")
        slowest = max(1.0, self.make.velocity_step)
        if self.max_velocity * self.counts_per_radian < slowest:
            least = "a count" if slowest == 1.0 else f"{slowest:g} counts"
            raise ValueError(
                f"'max_velocity_deg_s' must be at least {least} a second, got "
                f"{math.degrees(self.max_velocity):g}"
            )
        step = self.acceleration_step / self.counts_per_radian
        if self.max_acceleration < step:
            finer = "" if self.make is not PIC_SERVO else "; a larger 'rate_divisor' makes it finer"
            raise ValueError(
                f"'max_acceleration_deg_s2' must be at least {math.degrees(step):.4g} "
                f"({self.acceleration_step:.4g} counts/s^2, the step of the motor{finer}), got "
                f"{math.degrees(self.max_acceleration):g}"
            )
        acceleration = self.largest_acceleration / self.counts_per_radian
        if 1.5 * self.max_velocity / acceleration > LONGEST_STOP + 1e-9:
            raise ValueError(
                f"from 'max_velocity_deg_s' {math.degrees(self.max_velocity):g} it cannot stop in "
                f"time when the host goes silent: 'max_acceleration_deg_s2' must be at least "
                f"{math.degrees(self.max_velocity * 1.5 / LONGEST_STOP + step):g}, got "
                f"{math.degrees(self.max_acceleration):g}"
            )
        self._check_speeds()

    def _check_speeds(self) -> None:
        velocity = self.max_velocity * self.counts_per_radian
        acceleration = self.max_acceleration * self.counts_per_radian
        for key, asked, largest, unit in (
            ("max_velocity_deg_s", velocity, self.make.largest_velocity, "counts/s"),
            ("max_acceleration_deg_s2", acceleration, self.make.largest_acceleration, "counts/s^2"),
        ):
            if asked > largest:
                raise ValueError(f"{key!r} must be at most {largest:g} {unit}, got {asked:g}")
        if self.make is not PIC_SERVO:
            return
        divisor = self.gains.rate_divisor
        try:
            velocity_units(velocity, divisor)
            acceleration_units(acceleration, divisor)
        except ValueError as error:
            raise ValueError(f"the board cannot count that fast: {error}") from None

    def _check_home(self) -> None:
        home = self.home
        if home.method not in HOME_METHODS:
            raise ValueError(
                f"home 'method' must be one of {', '.join(HOME_METHODS)}, got {home.method!r}"
            )
        if home.method != "here" and self.make is not PIC_SERVO:
            raise ValueError(
                f"home 'method' must be 'here', got {home.method!r}: {self.make.title} have no "
                "marks to look for, and keep their zero"
            )
        turn = 2.0 * math.pi
        if not self.lower - turn <= home.at <= self.upper + turn:
            raise ValueError(
                f"home 'at_deg' must lie less than a turn beyond the limits, got "
                f"{math.degrees(home.at):g}"
            )
        if home.method == "here":
            return
        if home.travel > self.upper - self.lower + turn:
            raise ValueError(
                f"home 'travel_deg' must be at most a turn more than the joint's range, got "
                f"{math.degrees(home.travel):g}"
            )
        if not (0.0 < abs(home.speed) <= self.max_velocity and home.travel > 0.0):
            raise ValueError(
                f"home by {home.method} needs 'speed_deg_s' (not zero, at most "
                f"{math.degrees(self.max_velocity):g}) and a positive 'travel_deg', got "
                f"{math.degrees(home.speed):g} and {math.degrees(home.travel):g}"
            )

    @property
    def counts_per_radian(self) -> float:
        """Counts of a radian of the encoder's angle."""
        return self.counts_per_turn / (2.0 * math.pi)

    @property
    def acceleration_step(self) -> float:
        """What accelerations are multiples of [counts/s^2]; 0 where they are as good as any."""
        if self.make is not PIC_SERVO:
            return self.make.acceleration_step
        step = acceleration_step(self.gains.rate_divisor)
        limit = self.max_acceleration * self.counts_per_radian
        return step if step > _COARSE * limit else 0.0

    @property
    def largest_acceleration(self) -> float:
        """The limit, rounded down to what the motor has [counts/s^2]."""
        limit, step = self.max_acceleration * self.counts_per_radian, self.acceleration_step
        return step * math.floor(limit / step + 1e-9) if step else limit

    @property
    def output_mode(self) -> int:
        """What I/O Control must be before the amplifier is switched on."""
        return OUTPUTS[self.output]

    def register(self, reading: float) -> int:
        """Return the motor's counts at a reading [counts]."""
        return round(self.sign * reading) + self._zero

    def reading(self, register: float) -> float:
        """Return the reading [counts] at the motor's counts."""
        return self.sign * (register - self._zero)

    @property
    def _zero(self) -> int:
        return self.zero_counts or 0

    @property
    def still(self) -> int:
        """What the joint may move between two readings without a second look [counts]."""
        return self.make.still

    def faster(self, velocity: float) -> float:
        """Return the next speed that the motor has, at least that given [counts/s]."""
        step = self.make.velocity_step
        return velocity if step == 0.0 else step * max(1.0, math.ceil(velocity / step - 1e-9))

    @property
    def lower_reading(self) -> float:
        """Lowest reading that may be commanded [counts]."""
        return self.lower * self.counts_per_radian

    @property
    def upper_reading(self) -> float:
        """Highest reading that may be commanded [counts]."""
        return self.upper * self.counts_per_radian


@dataclass(frozen=True)
class ServoConfig:
    """The servos of one robot.

    Raises:
        ValueError: If two joints share a name or an address, or a value is not valid.
    """

    name: str
    joints: tuple[JointServo, ...]
    """In the order in which poses are written."""
    baud: int = 0
    """Of the line; 0 is that which the make has from the factory."""
    heartbeat: float = 0.3
    """How long the arm goes on when the host is silent [s]; then it stops."""
    latency: float = 1e-3
    """Latency timer of the adapter [s]."""

    def __post_init__(self) -> None:
        """Check the values."""
        if not self.name.strip():
            raise ValueError("'name' must not be empty")
        if not self.joints:
            raise ValueError("'joints' must not be empty")
        for what in ("name", "address"):
            values = [getattr(joint, what) for joint in self.joints]
            twice = sorted({value for value in values if values.count(value) > 1})
            if twice:
                raise ValueError(f"{what} {twice[0]!r} is given to two joints")
        others = [joint.make.name for joint in self.joints if joint.make is not self.make]
        if others:
            raise ValueError(f"joints of makes {self.make.name} and {others[0]} cannot share a bus")
        object.__setattr__(self, "baud", self.baud or self.make.bauds[0])
        if self.baud not in self.make.bauds:
            raise ValueError(f"'baud' must be one of {sorted(self.make.bauds)}, got {self.baud}")
        if not 0.1 <= self.heartbeat <= 2.0:
            raise ValueError(f"'heartbeat_s' must be 0.1 to 2, got {self.heartbeat:g}")
        if not 0.0 < self.latency <= 0.1:
            raise ValueError(f"'latency_ms' must be above 0, at most 100, got {self.latency * 1e3}")

    @property
    def make(self) -> Make:
        """The make of its motors."""
        return self.joints[0].make

    @property
    def joint_names(self) -> tuple[str, ...]:
        """Names in order."""
        return tuple(joint.name for joint in self.joints)

    @property
    def joint_infos(self) -> tuple[JointInfo, ...]:
        """The joints as a data set describes them; its readings are those of the controller."""
        return tuple(
            JointInfo(
                joint.name,
                "counts",
                counts_per_turn=joint.counts_per_turn,
                lower=joint.lower_reading,
                upper=joint.upper_reading,
            )
            for joint in self.joints
        )

    def servo_map(self, learned: ServoMap | None = None) -> ServoMap:
        """Return the map between readings [counts] and joint displacements of all joints.

        Args:
            learned: Of a self-model; joints that it does not know keep gear 1 and zero 0.

        Raises:
            ValueError: If it is about joints that are not here, or about other encoders.
        """
        n = len(self.joints)
        offset, gear, sign = np.zeros(n), np.ones(n), np.ones(n)
        counts = np.array([joint.counts_per_turn for joint in self.joints], dtype=float)
        if learned is not None:
            places = self._places(learned, counts)
            offset[places], gear[places] = learned.offset, learned.gear
            sign[places] = learned.sign
        return ServoMap(self.joint_names, offset, gear, ("counts",) * n, counts, sign)

    def _places(self, learned: ServoMap, counts: NDArray) -> list[int]:
        strangers = [name for name in learned.joints if name not in self.joint_names]
        if strangers:
            raise ValueError(
                f"the self-model is about other joints: {', '.join(strangers)} is not among the "
                f"servos ({', '.join(self.joint_names)}); give the self-model of this arm"
            )
        places = [self.joint_names.index(name) for name in learned.joints]
        for place, unit, theirs in zip(places, learned.unit, learned.counts_per_turn, strict=True):
            if unit == "counts" and theirs != counts[place]:
                raise ValueError(
                    f"{self.joint_names[place]}: the self-model was learned with {theirs:g} counts "
                    f"a turn, the servo configuration says {counts[place]:g}: they do not belong "
                    "together"
                )
        return places
