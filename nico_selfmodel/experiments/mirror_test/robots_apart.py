"""The mirror test with its robots shared out among processes: no robot needs another."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

from nico_selfmodel.experiments.mirror_test.body_or_room import TurningStage
from nico_selfmodel.experiments.mirror_test.encounters import EncounterStage, check_trials
from nico_selfmodel.experiments.mirror_test.images import ImageStage
from nico_selfmodel.experiments.mirror_test.marks import MarkStage, check_marks
from nico_selfmodel.experiments.mirror_test.stages import MirrorTest, ended, run_stages
from nico_selfmodel.experiments.mirror_test.structure import StructureStage
from nico_selfmodel.experiments.mirror_test.touches import TouchStage
from nico_selfmodel.experiments.mirror_test.unknown_mirror import MirrorsStage
from nico_selfmodel.experiments.mirror_test.unmarked import UnmarkedStage
from nico_selfmodel.freed_memory import give_back_freed_memory
from nico_selfmodel.parallel import Workers
from nico_selfmodel.sessions.progress import Stage, telling
from nico_selfmodel.systems.rendering.mirror_scene import MirrorPlate
from nico_selfmodel.systems.rendering.renderer import draw_in_one_thread
from nico_selfmodel.systems.simulated.imperfections import Imperfections


@dataclass(frozen=True)
class _Share:
    """What one process does: some of the robots, and their share of the trials."""

    world: Imperfections
    seeds: tuple[int, ...]
    trials: int
    looks: int
    marks: int
    plate: MirrorPlate


def run_apart(
    world: Imperfections,
    seeds: Sequence[int],
    trials: int,
    looks: int,
    marks: int,
    plate: MirrorPlate,
    processes: int,
    progress: Stage | None = None,
) -> MirrorTest:
    """Let robots go through the test in several processes, and put what happened together.

    A process ends where one of its own robots fails, but for looks that surprise and marks that are
    missed, of which all tell together; a stage that one did not begin counts as not begun, but for
    one whose robots all refuse their mirrors.

    Args:
        world: As of `run_stages`, and all up to `plate` likewise.
        seeds: Which robots.
        trials: Encounters in all.
        looks: Of each robot at its unmarked body.
        marks: Trials with marks in all.
        plate: The glass from stage 2 on.
        processes: How many; no more than there are robots, nor than trials suffice for.
        progress: Told when one has ended.

    Raises:
        ValueError: If there are too few trials.
        EstimationError: If a robot cannot learn how its image follows its encoders.
    """
    check_trials(trials, len(seeds))
    check_marks(marks, len(seeds))
    dealt = shares_of(len(seeds), trials, marks, processes)
    shares = [
        _Share(world, tuple(seeds[begin:end]), own_trials, looks, own_marks, plate)
        for begin, end, own_trials, own_marks in dealt
    ]
    tell = telling(progress, "robots going through the test")
    return together(Workers(len(shares)).map(_run, shares, tell))


def shares_of(
    robots: int, trials: int, marks: int, processes: int
) -> list[tuple[int, int, int, int]]:
    """Deal robots and trials out, to as many processes as can have all kinds of trials each.

    Returns:
        First robot, the one after the last, encounters and trials with marks of each process.

    Raises:
        ValueError: If not even one process can.
    """
    for count in range(min(processes, robots), 0, -1):
        ends = [round(k * robots / count) for k in range(count + 1)]
        dealt = [[round(end * n / robots) for end in ends] for n in (trials, marks)]
        shares = [
            (a, b, t_b - t_a, m_b - m_a)
            for (a, b), (t_a, t_b), (m_a, m_b) in zip(*map(pairwise, (ends, *dealt)), strict=True)
        ]
        try:
            for a, b, own_trials, own_marks in shares:
                check_trials(own_trials, b - a)
                check_marks(own_marks, b - a)
        except ValueError:
            continue
        return shares
    raise ValueError(f"{trials} trials and {marks} marks are too few for {robots} robots")


def _run(share: _Share) -> MirrorTest:
    give_back_freed_memory()
    draw_in_one_thread()
    return run_stages(
        share.world, share.seeds, share.trials, share.looks, share.marks, share.plate, share=True
    )


def together(parts: Sequence[MirrorTest]) -> MirrorTest:
    """Return one test of what happened in several, robot by robot in their order."""
    encounters = [part.encounters for part in parts]
    met = EncounterStage(
        _all(encounters, "trials"),
        {seed: one for stage in encounters for seed, one in stage.responses.items()},
        {seed: age for stage in encounters for seed, age in stage.latencies.items()},
    )
    errors = [part.error for part in parts if part.error is not None]
    # A share of whose robots none trusts its mirrors has nobody to go on.
    trusting = [one for one in parts if one.mirrors is None or one.mirrors.places] or parts
    whole = MirrorTest(
        met,
        _joined(parts, "images", lambda found: ImageStage(_all(found, "trials"))),
        _joined(parts, "turning", _turning),
        _joined(parts, "mirrors", _mirrors),
        _joined(trusting, "structure", _structure),
        _joined(trusting, "unmarked", _unmarked),
        _joined(trusting, "marks", _marks),
        _joined(trusting, "touches", _touches),
        errors[0] if errors else None,
    )
    return ended(whole)


def _joined(parts: Sequence[MirrorTest], name: str, join: Any) -> Any:
    """Return a stage of all parts; None where one did not begin it."""
    found = [getattr(part, name) for part in parts]
    return None if any(one is None for one in found) else join(found)


def _all(stages: Sequence[Any], name: str) -> tuple[Any, ...]:
    return tuple(one for stage in stages for one in getattr(stage, name))


def _turning(found: Sequence[TurningStage]) -> TurningStage:
    return TurningStage({seed: own for stage in found for seed, own in stage.looks.items()})


def _mirrors(found: Sequence[MirrorsStage]) -> MirrorsStage:
    return MirrorsStage(_all(found, "places"), _all(found, "refusals"))


def _structure(found: Sequence[StructureStage]) -> StructureStage:
    shapes = {seed: shape for stage in found for seed, shape in stage.shapes.items()}
    links, refusals = _all(found, "links"), _all(found, "refusals")
    return StructureStage(links, found[-1].mirrors, refusals, shapes, found[-1].poses)


def _unmarked(found: Sequence[UnmarkedStage]) -> UnmarkedStage:
    return UnmarkedStage(_all(found, "looks"), found[0].shown, _all(found, "paints"))


def _marks(found: Sequence[MarkStage]) -> MarkStage:
    shown = [stage.shown for stage in found if stage.shown is not None]
    return MarkStage(_all(found, "trials"), shown[0] if shown else None, _all(found, "watched"))


def _touches(found: Sequence[TouchStage]) -> TouchStage:
    drawn, shaped = (sum(getattr(one, name) for one in found) for name in ("drawn", "shaped"))
    return TouchStage(_all(found, "marks"), _all(found, "plans"), drawn, shaped)
