"""Stage 4 of the mirror test: an unmarked body does not surprise."""

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.sessions.looks.expecting import MirrorLook
from nico_selfmodel.sessions.looks.least_unknown import COLOR_SIGMA
from nico_selfmodel.sessions.looks.mirror_looks import MirrorLooks
from nico_selfmodel.sessions.mirrors.acquaintance import rendered
from nico_selfmodel.sessions.mirrors.knowing import Knowing
from nico_selfmodel.sessions.mirrors.mirror_scenario import MIRROR
from nico_selfmodel.sessions.mirrors.nico_before_mirrors import DEFAULT_MIRROR, NicoBeforeMirrors
from nico_selfmodel.sessions.progress import Stage, of_robot
from nico_selfmodel.systems.rendering.body_image import BodyImage
from nico_selfmodel.systems.rendering.stereo_cameras import ImageQuality

LIGHTS = (1.0, 0.9, 1.1)
"""How bright the pictures are, of what the description's light makes them."""
_DAY = 7
_KNOWN = 0.05
"""Paints that are known to that share count as seen."""


@dataclass(frozen=True)
class Look:
    """Both cameras' look at an unmarked body."""

    robot: int
    """Seed of the robot."""
    light: float
    """How bright it was, which the robot was not told."""
    gains: tuple[float, float]
    """How bright the robot found it, left and right."""
    judged: tuple[int, int]
    """Pixels that were judged."""
    chi_square: tuple[float, float]
    """Their mean z^2, 3 where every sigma is right."""
    alarms: int
    """Surprising places that are none."""
    where: tuple[str, ...] = ()
    """Which: camera, link and pixel of each."""
    judged_arm: tuple[int, int] = (0, 0)
    """Pixels of the arm that were judged."""


@dataclass(frozen=True, eq=False)
class PaintsOff:
    """What a robot's colours are off by, but for how bright all of them are."""

    robot: int
    """Seed of the robot."""
    described: NDArray
    """Of the description, paint by paint of those that it knows, as a share. Shape (P,)."""
    learned: NDArray
    """Of what it has learned. Shape (P,)."""
    sigma: NDArray
    """What it is not known by. Shape (P,)."""


@dataclass(frozen=True, eq=False)
class UnmarkedStage:
    """All looks of the fourth stage."""

    looks: tuple[Look, ...]
    """In the order in which they were made."""
    shown: tuple[MirrorLook, MirrorLook]
    """One of them, for the report."""
    paints: tuple[PaintsOff, ...] = ()
    """Of each robot."""


def run_unmarked(
    robots: Sequence[Knowing], looks: int, progress: Stage | None = None
) -> UnmarkedStage:
    """Let robots look into a mirror at their unmarked bodies.

    Args:
        robots: Who know themselves and their mirrors.
        looks: Of each robot, at random poses, with the lights in turn.
    """
    done: list[Look] = []
    paints = tuple(_paints(known) for known in robots)
    shown: tuple[MirrorLook, MirrorLook] | None = None
    for i, known in enumerate(robots):
        stage = of_robot(progress, i, len(robots))
        for k, light in enumerate(LIGHTS):
            for pair, links, arm in _look(known, light, len(range(k, looks, len(LIGHTS)))):
                done.append(_counted(known.robot.seed, light, pair, links, arm))
                stage("looking at itself", len(done) - i * looks, looks)
                shown = shown or pair
    assert shown is not None, "there is a look a robot at least"
    return UnmarkedStage(tuple(done), shown, paints)


def _paints(known: Knowing) -> PaintsOff:
    """Hold the colours that a robot has learned against the truth."""
    with known.before.station(_DAY) as station:
        surfaces = station.surfaces_true(station.CreateDefaultContext())
    with BodyImage(known.before.nico.arm, known.robot.model) as image:
        described, paints = image.surfaces, [tuple(color) for color in image.paints.tolist()]
    true = {
        tuple(color): real
        for link, own in described.items()
        if len(own.colors) == len(surfaces[link][0].colors)  # hands are marked otherwise
        for color, real in zip(own.colors.tolist(), surfaces[link][0].colors, strict=True)
    }
    found = known.body.paints
    seen = [k for k, color in enumerate(paints) if found.sigma[k] < _KNOWN and color in true]
    real = np.array([true[paints[k]] for k in seen]).reshape(-1, 3)
    described, learned = (_off(one[seen] / real) for one in (found.described, found.colors))
    # Colours and the light on them, as the expectation counts them.
    sigma = np.hypot(found.sigma[seen], COLOR_SIGMA)
    return PaintsOff(known.robot.seed, described, learned, sigma)


def _off(shares: NDArray) -> NDArray:
    """Return what each colour is off by: root mean square of its shares. Shape (P, 3) -> (P,)."""
    if not len(shares):
        return np.zeros(0)
    return np.sqrt(np.mean((shares / np.median(shares) - 1.0) ** 2, axis=1))


def _look(
    known: Knowing, light: float, count: int
) -> Iterator[tuple[tuple[MirrorLook, MirrorLook], Mapping[int, str], Collection[int]]]:
    """Look at oneself in one light, at poses drawn anew; with links by number, and the arm's."""
    robot = known.robot
    nico = rendered(robot, ImageQuality(gain=light))
    before = NicoBeforeMirrors(nico, {MIRROR: DEFAULT_MIRROR}, plate=known.before.plate)
    view, mirror = before.views[MIRROR], known.body.mirror(MIRROR)
    rng = np.random.default_rng((robot.seed, 44, round(100 * light)))
    with BodyImage(nico.arm, robot.model) as image, before.station(_DAY) as station:
        known.body.pose(image)
        looks = MirrorLooks(station, image, robot.model, mirror, view.X_BM)
        looks.before_known(MIRROR, known.body, known.unknown[MIRROR], view.X_BM)
        links = dict(image.links)
        for command in rng.choice(known.poses[MIRROR], count):
            yield looks.look(command), links, image.moving


def _counted(
    robot: int,
    light: float,
    pair: tuple[MirrorLook, MirrorLook],
    links: Mapping[int, str],
    arm: Collection[int],
) -> Look:
    """Return what is kept of a look."""
    judged = [np.isfinite(one.surprise.chi_square) for one in pair]
    own = [
        int((where & np.isin(one.labels, [*arm])).sum())
        for one, where in zip(pair, judged, strict=True)
    ]
    means = [
        float(np.mean(one.surprise.chi_square[where]))
        for one, where in zip(pair, judged, strict=True)
    ]
    return Look(
        robot,
        light,
        (pair[0].surprise.gain, pair[1].surprise.gain),
        (int(judged[0].sum()), int(judged[1].sum())),
        (means[0], means[1]),
        sum(len(one.blobs) for one in pair),
        tuple(
            f"{one.side}: {links.get(int(one.labels[round(b.v), round(b.u)]), 'beside the body')} "
            f"at {b.u:.0f}, {b.v:.0f}"
            for one in pair
            for b in one.blobs
        ),
        (own[0], own[1]),
    )
