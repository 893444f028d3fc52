"""Recording how joints follow steps of their commands."""

from collections.abc import Mapping

import numpy as np
from numpy.typing import ArrayLike, NDArray

from nico_selfmodel.dataset.motion.motion_recording import MotionRecording
from nico_selfmodel.errors import BusError
from nico_selfmodel.progress import Progress, telling_nobody
from nico_selfmodel.servos import ArmController

_PATIENCE = 3.0
"""Beyond the planned end of a step, before it counts as never ending [s]."""
_APART = 1e-6
"""Two rows are at least that far apart [s]."""


class _Rows:
    """Rows of a recording as they come."""

    def __init__(self) -> None:
        self.time: list[float] = []
        self.commanded: list[NDArray] = []
        self.read: list[NDArray] = []

    def add(self, time: float, commanded: NDArray, read: NDArray) -> None:
        """Add a row, unless nothing newer was read."""
        if not self.time or time > self.time[-1]:
            self.time.append(time)
            self.commanded.append(commanded.copy())
            self.read.append(read)

    def add_command(self, time: float, commanded: NDArray) -> None:
        """Add a row of a command, which is later than all before."""
        after = self.time[-1] + _APART if self.time else time
        self.add(max(time, after), commanded, np.full(len(commanded), np.nan))


def record_steps(
    arm: ArmController,
    plan: Mapping[str, ArrayLike],
    *,
    rest: float,
    name: str,
    speed: float | None = None,
    source: str = "",
    progress: Progress = telling_nobody,
) -> MotionRecording:
    """Send one joint after another through steps, and note commands and readings.

    A command is stamped when the packet that starts the joint is handed to the port, a reading
    when its reply was there: a response that is learned from them is later by what both packets
    take on the wire.

    Args:
        arm: Connected, the joints of the plan enabled.
        plan: Joint -> displacements to go to [rad].
        rest: How long a joint is watched before its first step, and after it arrived [s].
        speed: Largest joint speed [rad/s]; the limits if omitted.
        source: Where it is from, in words.
        progress: Told after each step.

    Returns:
        Times from the first row on, encoders in their own units.

    Raises:
        ValueError: If a target is beyond a limit.
        RobotError: If a joint fails or does not arrive; all others were stopped.
    """
    rows, done = _Rows(), 0
    steps = sum(len(np.atleast_1d(goals)) for goals in plan.values())
    told = arm.state().readings.astype(float)
    for joint, goals in plan.items():
        k = arm.joints.index(joint)
        _watch(arm, k, rows, told, arm.now() + rest)
        for goal in np.atleast_1d(goals).tolist():
            q = arm.servos.to_joint(told)
            q[k] = goal
            told[k] = arm.servos.to_encoder(q)[k]
            seconds = arm.move({joint: goal}, speed=speed)
            rows.add_command(_newest_reading(arm), told)
            late = arm.now() + 1.5 * seconds + _PATIENCE
            while arm.moving:
                _watch(arm, k, rows, told, arm.now())
                if arm.now() > late:
                    arm.stop()
                    raise BusError(f"{joint} did not arrive in {1.5 * seconds + _PATIENCE:.1f} s")
            _watch(arm, k, rows, told, arm.now() + rest)
            done += 1
            progress("making steps", done, steps)
    time = np.array(rows.time)
    infos = arm.config.joint_infos
    return MotionRecording(
        name, infos, time - time[0], np.stack(rows.commanded), np.stack(rows.read), source
    )


def _newest_reading(arm: ArmController) -> float:
    """Return when a joint was read last [s].

    After `move` that is when the joint was started: it tells all joints that hold where to stay,
    reads each, and starts them by one packet more.
    """
    state = arm.state()
    return state.time - float(state.age.min())


def _watch(arm: ArmController, joint: int, rows: _Rows, told: NDArray, until: float) -> None:
    """Read all joints at least once, until a time; rows are stamped when the joint was read."""
    while True:
        arm.heartbeat()
        state = arm.cycle()
        rows.add(state.time - float(state.age[joint]), told, state.readings.astype(float))
        if arm.now() >= until:
            return
