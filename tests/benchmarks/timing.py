"""How benchmarks compare functions."""

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
