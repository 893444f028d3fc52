"""Bodies and what drives and watches them; the simulated arm under motion capture."""

from nico_selfmodel.systems.simulated_arm import Sighting, SimulatedArm
from nico_selfmodel.systems.worlds import WORLDS, World, world_named

__all__ = ["WORLDS", "Sighting", "SimulatedArm", "World", "world_named"]
