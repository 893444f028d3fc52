"""Bodies and what drives and watches them; a simulated arm and simulated eyes."""

from nico_selfmodel.systems.simulated_arm import Sighting, SimulatedArm
from nico_selfmodel.systems.simulated_eyes import NICO_EYES, SimulatedEyes
from nico_selfmodel.systems.worlds import WORLDS, World, world_named

__all__ = [
    "NICO_EYES",
    "WORLDS",
    "Sighting",
    "SimulatedArm",
    "SimulatedEyes",
    "World",
    "world_named",
]
