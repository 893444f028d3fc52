"""How long a mirror takes: 50 poses, both cameras, one plane, robust, with its covariance."""

import pytest

from nico_selfmodel.estimation.mirrors.mirror_solution import solve_mirrors, start_mirrors
from nico_selfmodel.estimation.mirrors.reflections import ReflectionNoise, Reflections
from nico_selfmodel.experiments.mirror_body import mirror_body

pytestmark = pytest.mark.benchmark


def test_fifty_poses_are_solved_in_fifteen_milliseconds(benchmark):
    body = mirror_body(0)
    reflections = Reflections.from_dataset(body.watch("middle", 50), body.calibrated())
    noise = ReflectionNoise(0.3, 0.005)
    start = start_mirrors(reflections)
    solution = benchmark(solve_mirrors, reflections, start, noise)
    assert solution.converged
    assert len(solution.reflections) == 50
    assert benchmark.stats.stats.min <= 0.015
