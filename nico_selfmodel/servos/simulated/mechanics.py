"""What hangs on a simulated motor."""

import math
from dataclasses import dataclass


@dataclass
class SimulatedMechanics:
    """What hangs on the shaft, in counts from where the shaft was first powered up."""

    lower_switch: float = -math.inf
    """Below it limit input 2 is active."""
    upper_switch: float = math.inf
    """Above it limit input 1 is active."""
    lower_stop: float = -math.inf
    upper_stop: float = math.inf
    """Nothing turns the shaft beyond the stops."""
    counts_per_index: int = 2000
    """Distance of the encoder's index marks."""
    stuck: bool = False
    """Whether the shaft is jammed where it is."""
