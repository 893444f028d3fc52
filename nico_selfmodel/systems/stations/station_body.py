"""Driving any station with named ports: go there, wait until it stands still, look."""

import time
from collections.abc import Sequence
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import Context, System

from nico_selfmodel.dataset.joint_info import JointInfo
from nico_selfmodel.errors import RobotError
from nico_selfmodel.systems.hardware.reading_times import ReadingTimes
from nico_selfmodel.systems.image_values import bgr_of
from nico_selfmodel.systems.measurements import CameraMeasurement, Measurement

_TICK = 0.02
"""Time between two looks at the encoders [s]."""
_FEWEST = 4
"""New readings at rest that a sample needs at least, however rarely the joints are read."""
_NUDGE = 0.02
"""Share of a joint's range that it leaves a pose by, before it comes back to it."""


@dataclass(frozen=True)
class SettleTimeouts:
    """When a station counts as standing still, and how long it is waited for."""

    settle: float = 0.1
    """How long the encoders must not change before a sample [s]."""
    dither: float = 0.0
    """Change that counts as none, as a share of a joint's range: a servo holds by correcting."""
    astray: float = np.inf
    """How far from its command a joint may come to rest, as a share of its range."""
    timeout: float = 20.0
    """How long a motion may take [s]."""
    look_again: float = 0.0
    """How long to look again where no marker was located, before the pose is given up [s]."""
    real_time: bool = False
    """Whether the station lives in real time: then time is waited for, never caught up with."""


class StationBody:
    """A station that can be sent to poses and asked what it senses.

    The station needs the ports `encoders_commanded` and `encoders`, and `pixels` to be watched by
    its own cameras or `p_WH_measured` to be watched by motion capture, as `NicoStation` tells.

    Where a part of it has the port `read_at`, as `ServoDriver`, only readings that are newer than
    the last one say that a joint stands, and one that was made after a look confirms it: replies of
    motors may be late, and what was read before them then stays as it is. A station without such a
    port counts as read whenever it is looked at.
    """

    def __init__(
        self,
        station: System,
        joints: Sequence[JointInfo],
        markers: Sequence[str],
        *,
        sensor: str = "cameras",
        patience: SettleTimeouts | None = None,
        keep_images: bool = False,
    ) -> None:
        """Take a station.

        Args:
            station: It; its inputs other than `encoders_commanded` must be fixed or not needed.
            joints: Names, units and stops.
            markers: In the order of the sensor's port.
            sensor: `cameras` or `motion-capture`.
            patience: When it stands still; that of simulated servos if omitted.
            keep_images: Keep the pictures in the measurements; needs `left_image`, `right_image`.

        Raises:
            RobotError: If a port is missing or of another size.
            ValueError: If there is no such sensor.
        """
        if sensor not in ("cameras", "motion-capture"):
            raise ValueError(f"sensor must be cameras or motion-capture, got {sensor!r}")
        self.joints, self.markers, self.sensor = tuple(joints), tuple(markers), sensor
        self._patience, self._keep_images = patience or SettleTimeouts(), keep_images
        self._span = np.array(
            [
                np.inf if j.lower is None or j.upper is None else j.upper - j.lower
                for j in self.joints
            ]
        )
        self._dither = self._patience.dither * np.where(np.isfinite(self._span), self._span, 0.0)
        self._station, self._times = station, ReadingTimes(station)
        self._command = station.GetInputPort(_named(station, "encoders_commanded", "input"))
        self._check("encoders", len(self.joints))
        seen_by, width = ("pixels", 4) if sensor == "cameras" else ("p_WH_measured", 3)
        self._check(seen_by, width * len(self.markers))
        if keep_images:
            for camera in ("left", "right"):
                _named(station, f"{camera}_image", "output")
        self._port = seen_by
        self.simulator = Simulator(station)
        start = self._read("encoders")
        self._last = start
        self._command.FixValue(self.context, start)
        if station.HasInputPort("other_commanded"):
            # Nobody moves a second robot here: it stands as the first one starts.
            station.GetInputPort("other_commanded").FixValue(self.context, start)
        self.simulator.Initialize()

    @property
    def context(self) -> Context:
        """The station's context."""
        return self.simulator.get_mutable_context()

    def move_and_measure(self, command: ArrayLike) -> Measurement:
        """Move to encoder readings, settle, and look.

        A body that is sent to where it stands leaves and comes back, so that every visit is one.

        Args:
            command: Where to go [encoder units]. Shape (n,).

        Returns:
            What was sensed there; `CameraMeasurement` from cameras.

        Raises:
            RobotError: If the joints do not come to rest, or are not read, in time.
            ValueError: If the command has another length or is not finite.
        """
        command = np.asarray(command, dtype=float)
        self._move(command)
        measurement = self._look_at_rest(command)
        end = self.context.get_time() + self._patience.look_again
        while not _located(measurement) and self.context.get_time() < end:
            self._tick()
            measurement = self._look_at_rest(command)
        return measurement

    def relive(self, command: ArrayLike) -> None:
        """Move as in an earlier visit, without a look: time and play then stand where they stood.

        A station that lives in real time cannot: for it nothing happens.

        Args:
            command: Where to go [encoder units]. Shape (n,).

        Raises:
            RobotError: If the joints do not come to rest in time.
            ValueError: If the command has another length or is not finite.
        """
        if not self._patience.real_time:
            self._move(np.asarray(command, dtype=float))

    def _move(self, command: NDArray) -> None:
        if command.shape != (len(self.joints),) or not np.isfinite(command).all():
            raise ValueError(f"command must be {len(self.joints)} finite readings, got {command}")
        if np.array_equal(np.round(command), np.round(self._last)):
            self._go(self._beside(command))
        self._go(command)
        self._last = command

    def _beside(self, command: NDArray) -> NDArray:
        """Return a pose a little way off, towards the middle of the joints' ranges."""
        beside = command.copy()
        for i, joint in enumerate(self.joints):
            low, high = joint.lower, joint.upper
            if low is not None and high is not None:
                beside[i] += (
                    _NUDGE * (high - low) * (1.0 if 2.0 * command[i] < low + high else -1.0)
                )
        return beside

    def _go(self, command: NDArray) -> None:
        """Command and wait until the encoders stand still where they were sent."""
        self._command.FixValue(self.context, command)
        self._settle(command)
        away = self._read("encoders") - command
        if (np.abs(away) > self._patience.astray * self._span).any():
            raise RobotError(
                f"the joints came to rest elsewhere: {self._farthest(away)}; is it blocked, off, "
                "or overloaded?"
            )

    def _settle(self, command: NDArray) -> None:
        """Wait until the encoders stand still, wherever that is."""
        patience, end = self._patience, self.context.get_time() + self._patience.timeout
        still, before, read_at = 0.0, self._read("encoders"), self._read_at()
        # The first tick starts the motion.
        self._tick()
        while still < patience.settle:
            now, later = self._read("encoders"), self._read_at()
            if later > read_at:
                if (np.abs(now - before) <= self._dither).all():
                    still += self._weight(later - read_at)
                else:
                    still, before = 0.0, now
                read_at = later
            if self.context.get_time() > end:
                raise RobotError(
                    f"the joints did not come to rest within {patience.timeout:g} s: "
                    f"{self._farthest(now - command)}; is it blocked or off?"
                )
            self._tick()

    def _look_at_rest(self, command: NDArray) -> Measurement:
        """Look; again, if the encoders are elsewhere when they are read next."""
        measurement, end = self._look(), self.context.get_time() + self._patience.timeout
        while self._times.are_known and not self._alike(self._read_next(), measurement.encoders):
            if self.context.get_time() > end:
                raise RobotError(
                    f"the joints did not stay at rest within {self._patience.timeout:g} s: "
                    f"{self._farthest(self._read('encoders') - command)}; does one swing or sag?"
                )
            self._go(command)
            measurement = self._look()
        return measurement

    def _read_next(self) -> NDArray:
        """Wait for encoder readings that are newer than those there are, and return them."""
        read_at, end = self._read_at(), self.context.get_time() + self._patience.timeout
        while self._read_at() <= read_at:
            if self.context.get_time() > end:
                raise RobotError(
                    f"the joints were not read for {self._patience.timeout:g} s: is the bus lost?"
                )
            self._tick()
        return self._read("encoders")

    def _read_at(self) -> float:
        """Return when the encoders were read, by a clock of their own [s]."""
        known = self._times.are_known
        return self._times.oldest(self.context) if known else self.context.get_time()

    def _weight(self, passed: float) -> float:
        """Return for how long a new reading says that joints stood, a time after the last [s]."""
        return min(passed, self._patience.settle / _FEWEST) if self._times.are_known else _TICK

    def _alike(self, one: NDArray, other: NDArray) -> bool:
        """Return whether two readings are of one rest, of which each may be that far off."""
        return bool((np.abs(one - other) <= 2.0 * self._dither).all())

    def _farthest(self, away: NDArray) -> str:
        distance = np.where(np.isfinite(away), np.abs(away), np.inf)
        worst = int(np.argmax(distance))
        if not np.isfinite(distance[worst]):
            return f"{self.joints[worst].name} is not read"
        return f"{self.joints[worst].name} reads {distance[worst]:.0f} units away from its command"

    def _tick(self) -> None:
        begin = time.monotonic()
        self.simulator.AdvanceTo(self.context.get_time() + _TICK)
        if self._patience.real_time:
            time.sleep(max(0.0, begin + _TICK - time.monotonic()))

    def _look(self) -> Measurement:
        encoders = self._read("encoders")
        values = self._read(self._port).reshape(len(self.markers), -1)
        if self.sensor == "motion-capture":
            points = {
                marker: p if np.isfinite(p).all() else None
                for marker, p in zip(self.markers, values, strict=True)
            }
            return Measurement(encoders, MappingProxyType(points))
        images = None
        if self._keep_images:
            left, right = (
                bgr_of(self._station.GetOutputPort(f"{camera}_image").Eval(self.context))
                for camera in ("left", "right")
            )
            images = left, right
        return CameraMeasurement(
            encoders,
            MappingProxyType(dict.fromkeys(self.markers)),
            MappingProxyType(dict(zip(self.markers, values, strict=True))),
            images,
            self._reasons("reasons"),
            MappingProxyType(self._reflected()),
            self._reasons("reflected_reasons"),
        )

    def _reflected(self) -> dict[str, NDArray]:
        """Return the pixels of each marker's reflection, of a station before a mirror."""
        if not self._station.HasOutputPort("reflected_pixels"):
            return {}
        values = self._read("reflected_pixels").reshape(len(self.markers), 4)
        return dict(zip(self.markers, values, strict=True))

    def _reasons(self, port: str) -> tuple[str, ...]:
        if not self._station.HasOutputPort(port):
            return ()
        return tuple(self._station.GetOutputPort(port).Eval(self.context))

    def _read(self, port: str) -> NDArray:
        return np.array(self._station.GetOutputPort(port).Eval(self.context), dtype=float)

    def _check(self, port: str, size: int) -> None:
        found = self._station.GetOutputPort(_named(self._station, port, "output")).size()
        if found != size:
            raise RobotError(
                f"output port {port!r} of the station has {found} values, expected {size}: "
                f"{len(self.joints)} joints, markers {', '.join(self.markers)}"
            )


def _located(measurement: Measurement) -> bool:
    """Return whether an instrument located some marker."""
    if isinstance(measurement, CameraMeasurement):
        return any(np.isfinite(pixels).any() for pixels in measurement.pixels.values())
    return any(p is not None for p in measurement.points.values())


def _named(station: System, port: str, kind: str) -> str:
    """Return the name of a port after checking that it is there."""
    has = station.HasInputPort if kind == "input" else station.HasOutputPort
    if not has(port):
        count = station.num_input_ports() if kind == "input" else station.num_output_ports()
        get = station.get_input_port if kind == "input" else station.get_output_port
        names = ", ".join(get(i).get_name() for i in range(count)) or "none"
        raise RobotError(f"the station has no {kind} port {port!r}; it has {names}")
    return port
