"""What may hang on simulated servos: lag, load, friction, noise, weak motors, jams."""

import math
from dataclasses import dataclass, field

import numpy as np

from .arms import COUNTS_PER_TURN

DEGREE = COUNTS_PER_TURN / 360.0


@dataclass
class Mechanics:
    """A plant for `SimulatedLine`: where shafts stand that are commanded somewhere [counts].

    The load sags with the pose, as gravity does; friction holds the shaft within a band about where
    the servo would have it; a lag is of first order. All of it is healthy, a jam is not.
    """

    n: int
    rng: np.random.Generator
    lag: float = 0.0
    """Time constant [s]."""
    load: float = 0.0
    """Largest error that the weight causes [counts]."""
    friction: float = 0.0
    """Half the width of the band [counts]."""
    noise: float = 0.0
    """Standard deviation of a reading [counts]."""
    share: np.ndarray | None = None
    """Largest share of the commanded way that a joint can go; all of it if omitted."""
    jammed: set = field(default_factory=set)
    """Joints that nothing moves."""

    def __post_init__(self):
        self.place, self.time = np.zeros(self.n), None
        self.last = np.zeros(self.n)

    def __call__(self, time, commanded):
        passed = 0.0 if self.time is None else time - self.time
        self.time = time
        held = ~np.isnan(commanded)
        commanded = np.where(held, commanded, self.place)
        sag = self.load * np.sin(commanded / (60.0 * DEGREE) + np.arange(self.n))
        wanted = commanded - np.where(held, sag, 0.0)
        pulled = np.clip(self.place, wanted - self.friction, wanted + self.friction)
        gain = 1.0 if self.lag == 0.0 else 1.0 - math.exp(-passed / self.lag)
        step = gain * (pulled - self.place)
        if self.share is not None:
            most = self.share * np.abs(commanded - self.last) + 1e-9
            step = np.where(np.isnan(self.share), step, np.clip(step, -most, most))
        self.last = commanded
        free = [k not in self.jammed for k in range(self.n)]
        self.place = self.place + np.where(free, step, 0.0)
        noise = self.noise * self.rng.standard_normal(self.n)
        return np.round(self.place + np.where(free, noise, 0.0))
