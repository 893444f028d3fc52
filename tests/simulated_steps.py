"""Recordings of steps of joints whose response is known."""

import numpy as np

from nico_selfmodel.dataset.joint_info import JointInfo
from nico_selfmodel.dataset.motion.motion_recording import MotionRecording
from nico_selfmodel.model.response.servo_response import ServoResponse

SERVOS = (
    ServoResponse("shoulder", "profile", 0.04, 0.005, 1.0, 4.0),
    ServoResponse("elbow", "profile", 0.05, 0.005, 0.8, 6.0, 20.0),
    ServoResponse("wrist", "loop", 0.03, 0.005, 1.5, None, 8.0),
    ServoResponse("gripper", "loop", 0.04, 0.005, None, None, 6.0),
)
"""One of each kind."""
COUNTS = 4096
PAUSE = 2.0
"""From the end of one step's rows to the next [s]."""


def steps_recorded(
    servos=SERVOS,
    seed=0,
    *,
    count=12,
    period=0.02,
    largest=30.0,
    unit="counts",
    moves=lambda response, way, time: response.after(way, time),
):
    """Return what an encoder of 4096 counts reads while each joint in turn makes steps.

    Args:
        servos: True responses.
        seed: Of sizes, delays and times.
        count: Steps of each.
        period: Mean time between two readings [s].
        largest: Largest step [deg].
        unit: Of the encoders.
        moves: Where a joint is on its way: response, way [rad] and times since the command [s].
    """
    rng, n = np.random.default_rng(seed), len(servos)
    turn = {"counts": COUNTS, "deg": 360.0, "rad": 2.0 * np.pi}[unit]
    size, time, place = 2.0 * np.pi / turn, 0.0, np.zeros(n)
    rows = []
    for k, servo in enumerate(servos):
        sizes = rng.permutation(np.geomspace(0.1, 1.0, count)) * np.radians(largest)
        for number, angle in enumerate(sizes):
            rest = time + np.cumsum(period * rng.uniform(0.8, 1.2, 8))
            rows += [(t, place.copy(), place.copy()) for t in rest]
            goal = place.copy()
            goal[k] += (
                np.round(angle / (2.0 * np.pi / COUNTS)) * 2.0 * np.pi / COUNTS * (-1) ** number
            )
            told = rest[-1] + period * rng.uniform(0.2, 1.0)
            rows.append((told, goal, np.full(n, np.nan)))
            delay = max(servo.delay + servo.delay_spread * rng.standard_normal(), 0.0)
            true = ServoResponse(servo.joint, servo.kind, delay, 0.0, **servo.parts)
            times = told + np.cumsum(period * rng.uniform(0.8, 1.2, round(PAUSE / period)))
            read = np.tile(place, (len(times), 1))
            read[:, k] += moves(true, goal[k] - place[k], times - told)
            rows += [(t, goal, row) for t, row in zip(times, read, strict=True)]
            time, place = float(times[-1]), goal
    times, told, read = (np.array(column) for column in zip(*rows, strict=True))
    grain = 2.0 * np.pi / COUNTS
    read = np.round(read / grain) * grain
    kind = {"counts_per_turn": COUNTS} if unit == "counts" else {}
    joints = tuple(JointInfo(servo.joint, unit, **kind) for servo in servos)
    return MotionRecording("steps", joints, times, told / size, read / size)
