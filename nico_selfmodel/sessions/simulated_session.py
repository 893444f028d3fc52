"""One recording session of a simulated arm under motion capture."""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.dataset.dataset import Dataset
from nico_selfmodel.planning.plans import given_commands
from nico_selfmodel.planning.sweep_protocol import SweepProtocol
from nico_selfmodel.plant import ArmDescription
from nico_selfmodel.recording.session import Progress, record
from nico_selfmodel.systems.simulated.imperfections import Imperfections
from nico_selfmodel.systems.simulated.robot import SimulatedRobot


def simulated_session(
    arm: ArmDescription,
    world: Imperfections,
    protocol: SweepProtocol,
    name: str,
    *,
    seed: int,
    session: int,
    sweeps: bool = True,
    folder: Path | None = None,
    poses: NDArray | None = None,
    progress: Progress | None = None,
) -> Dataset:
    """Record one session with one robot.

    Args:
        session: Of poses and noise.
        sweeps: Visit the circles too.
        folder: Where to keep the samples from the first one on; resumed if it is there.
        poses: Visited instead of random ones [encoder units]. Shape (N, n).

    Raises:
        ValueError: If a given pose lies beyond a joint's stop.
    """
    robot = SimulatedRobot.under_motion_capture(arm, world, seed, session)
    plan = protocol.plan(robot.joints, np.random.default_rng((seed, session, 2)), sweeps=sweeps)
    if poses is not None:
        plan = [pose for pose in plan if pose[0]] + given_commands(robot.joints, poses)
    return record(
        robot,
        plan,
        name,
        source=world.origin(f"simulated {arm.robot}", seed, session),
        seed=seed,
        point_sigma_m=world.marker_sigma or None,
        folder=folder,
        progress=progress,
    )
