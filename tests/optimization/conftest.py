"""Small problems with known answers."""

import numpy as np
import pytest

from nico_selfmodel.optimization.calibration_program import CalibrationProgram


class LinearBlock:
    """Residuals A x - b of N observations of k coordinates; A (p, k, N), b (k, N)."""

    def __init__(self, names, a, b):
        self.names, self.a, self.b = tuple(names), np.asarray(a, float), np.asarray(b, float)

    def evaluate(self, x):
        return np.tensordot(x, self.a, axes=1) - self.b, self.a


class DecayBlock:
    """Residuals height * exp(-rate t) - y: one coordinate, not linear."""

    def __init__(self, names, t, y):
        self.names, self.t, self.y = tuple(names), t, y

    def evaluate(self, x):
        wave = np.exp(-x[1] * self.t)
        return (x[0] * wave - self.y)[None], np.stack([wave, -x[0] * self.t * wave])[:, None]


@pytest.fixture(scope="session")
def linear_block():
    return LinearBlock


@pytest.fixture
def decay_block():
    t = np.linspace(0.0, 3.0, 30)
    noise = np.random.default_rng(1).normal(0.0, 0.02, 30)
    return DecayBlock(("height", "rate"), t, 2.0 * np.exp(-0.8 * t) + noise)


@pytest.fixture
def decay(decay_block):
    """Return a program that fits a decay, from afar."""
    program = CalibrationProgram()
    program.add_variables(["height", "rate"], [0.5, 0.1])
    program.add_residuals(decay_block)
    return program


@pytest.fixture
def distance_to():
    """Return a function that makes a program whose cost is |x - target|^2 / 2."""

    def make(target, start):
        names = [f"x{i}" for i in range(len(target))]
        program = CalibrationProgram()
        program.add_variables(names, start)
        program.add_residuals(
            LinearBlock(names, np.eye(len(target))[:, :, None], np.array(target)[:, None])
        )
        return program

    return make
