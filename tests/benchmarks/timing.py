"""How benchmarks compare functions."""

import resource
import subprocess
from time import perf_counter


def fastest(*functions, rounds=15):
    """Return the shortest time of each function [s], run in turn so that they share bad moments."""
    times = []
    for _ in range(rounds):
        row = []
        for function in functions:
            begin = perf_counter()
            function()
            row.append(perf_counter() - begin)
        times.append(row)
    return [min(column) for column in zip(*times, strict=True)]


def best_ratio(ours, peer, rounds=15):
    """Return how long ours takes for each second of the peer, in the quietest of three spells."""
    ratios = []
    for _ in range(3):
        mine, theirs = fastest(ours, peer, rounds=rounds)
        ratios.append(mine / theirs)
    return min(ratios)


def processor_seconds(*commands, rounds=5):
    """Return the least processor time of each command line [s], run in turn."""
    times = []
    for _ in range(rounds):
        row = []
        for command in commands:
            before = resource.getrusage(resource.RUSAGE_CHILDREN)
            subprocess.run(command, check=True, capture_output=True)
            after = resource.getrusage(resource.RUSAGE_CHILDREN)
            row.append(after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime)
        times.append(row)
    return [min(column) for column in zip(*times, strict=True)]
