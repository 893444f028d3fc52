"""Stage 7 of the mirror test: the finger goes to marks that were found, and nowhere else."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.estimation.mirrors.mark_place import ON_ME
from nico_selfmodel.experiments.mirror_test.marks import MarkStage, MarkTrial
from nico_selfmodel.experiments.mirror_test.painting import DIAMETER, MARK
from nico_selfmodel.geometry.transform import apply, inverse
from nico_selfmodel.model.shape.link_shape import BodyShape
from nico_selfmodel.plant.touching.posed_arm import Finger, PosedArm
from nico_selfmodel.plant.touching.touch_planner import (
    CLEAR,
    NARROW,
    WIDE,
    OutOfReach,
    Touch,
    TouchPlanner,
    between,
)
from nico_selfmodel.sessions.looks.known_body import Shot
from nico_selfmodel.sessions.looks.mirror_looks import MirrorLooks
from nico_selfmodel.sessions.looks.seen_arm import see_arm
from nico_selfmodel.sessions.mirrors.acquaintance import rendered
from nico_selfmodel.sessions.mirrors.knowing import LINKS, Knowing
from nico_selfmodel.sessions.mirrors.mirror_scenario import MIRROR
from nico_selfmodel.sessions.progress import Stage, of_robot
from nico_selfmodel.sessions.rendered_nico import RenderedNico
from nico_selfmodel.systems.closing import free_memory
from nico_selfmodel.systems.looking import FINGER
from nico_selfmodel.systems.rendering.body_image import BodyImage
from nico_selfmodel.systems.rendering.mark_on_body import Mark
from nico_selfmodel.systems.rendering.stereo_cameras import ImageQuality
from nico_selfmodel.systems.simulated.ground_truth import GroundTruth
from nico_selfmodel.systems.stations.nico_station import NicoStation

PLANS = 50
"""Ways to places drawn anywhere on head and chest, in all; marks are not needed for them."""
TRIES, SEEN_ON = 3, 2.5e-3
"""How often the finger goes to a mark, and within what it must then be seen of it [m]: what a look
tells of the finger is off by a millimetre, and a mark's radius is 5 mm."""
_DAY = 11
_POSTURES, _NEAR = 10000, 0.02
"""Postures that are drawn for these, a robot, and how near the finger must come to a link [m]."""


@dataclass(frozen=True, eq=False)
class Executed:
    """A way as the true arm went it, the last time."""

    off: float
    """Distance of the finger from the place along the surface [m]."""
    gap: float
    """Distance of the finger from the surface, negative inside [m]."""
    clearance: float
    """Least distance of the arm from the body whenever it went, the finger excepted [m]."""
    nearest: str
    """Links that were so near."""
    tries: int = 1
    """How often it went."""


@dataclass(frozen=True, eq=False)
class TouchTrial:
    """One place: what the robot planned, and how it went."""

    radius: float
    """Of the mark [m]."""
    way_exists: bool
    """Whether an arm and a body that are known exactly have a way there."""
    plan: Touch | OutOfReach
    """What the robot planned."""
    executed: Executed | None
    """How it went; None where the robot says that the place is out of reach."""

    @property
    def touched(self) -> bool:
        """Whether the finger came within the mark's radius."""
        return self.executed is not None and self.executed.off <= self.radius

    @property
    def collided(self) -> bool:
        """Whether anything but the finger touched the body."""
        return self.executed is not None and self.executed.clearance < 0.0

    @property
    def in_reach(self) -> bool:
        """Whether the place can be touched: there is a way, or it was touched all the same."""
        return self.way_exists or (self.touched and not self.collided)


@dataclass(frozen=True, eq=False)
class TouchStage:
    """All places that robots were to touch."""

    marks: tuple[TouchTrial, ...]
    """Those of marks that were found."""
    plans: tuple[TouchTrial, ...]
    """Those drawn anywhere on head and chest to which robots found a way."""
    drawn: int
    """Places that were drawn for these."""
    shaped: int = 0
    """Robots that planned with the shape they had learned, of those that planned."""


class TouchJudge:
    """Says how a true arm goes a way, and whether a place is in its reach."""

    def __init__(self, nico: RenderedNico) -> None:
        """Take a robot, behind the door of what only the simulation knows."""
        self._truth: GroundTruth = nico.ground_truth
        model, held = self._truth.model(), self._truth.held
        self._planner, self._narrow = (
            TouchPlanner(nico.arm, model, FINGER, held=held, limits=self.stops, clear=clear)
            for clear in ((CLEAR,), (CLEAR, NARROW))
        )
        self._posed = PosedArm(nico.arm, model, FINGER, held).as_drawn()

    @property
    def stops(self) -> NDArray:
        """Least and largest readings, which its data sets state too. Shape (2, n)."""
        mechanics = self._truth.instance.arm
        return np.stack([mechanics.lower, mechanics.upper])

    @property
    def finger(self) -> Finger:
        """Where the finger is on the hand, as the robot is described."""
        return self._posed.finger

    def stood(self, station: NicoStation, context: Any) -> NDArray:
        """Return how the true joints stand in a station, which a robot is not told [rad]. (n,)."""
        servos = station.GetSubsystemByName("servos")
        own = servos.GetMyContextFromRoot(context)
        return np.array(servos.GetOutputPort("q_true").Eval(own))

    def way_exists(
        self, mark: Mark, n_F: NDArray, plan: Touch | OutOfReach, rng: np.random.Generator
    ) -> bool:
        """Return whether an arm and a body that are known exactly have a way to a place.

        It keeps as far from the body as the robot's own way, which need not be the usual distance,
        and is looked for from where that ends, too.
        """
        if mark.link in self._posed.moving:
            return False
        near, planner = None, self._planner
        if isinstance(plan, Touch):
            near = plan.readings[-1]
            planner = self._planner if plan.clearance >= CLEAR else self._narrow
        return isinstance(planner.at_place(mark.link, mark.p_FM, n_F, rng, near=near), Touch)

    def go(self, plan: Touch, mark: Mark, n_F: NDArray, rng: np.random.Generator) -> Executed:
        """Go a way once as the true arm goes it, joints loose as they are.

        Args:
            mark: Where the mark really is.
            n_F: Outward normal there, in the frame of its link. Shape (3,).
            rng: Source of what the joints leave to chance.
        """
        mechanics = self._truth.instance.arm
        q = [mechanics.angles(mechanics.dragged(mechanics.reached(r)), rng) for r in plan.readings]
        return self.gone([np.array(q)], mark, n_F)

    def gone(self, ways: Sequence[NDArray], mark: Mark, n_F: NDArray) -> Executed:
        """Judge ways by where the true joints stood, of which the last one counts for the place.

        Args:
            ways: True angles in the postures of each [rad]. Shape (k, n) each.
            mark: Where the mark really is.
            n_F: Outward normal there, in the frame of its link. Shape (3,).
        """
        posed, near = self._posed, []
        for posture in np.concatenate([between(way) for way in ways]):
            posed.pose(posture)
            near.append(posed.clearance())
        X_LF = posed.link_pose(mark.link)
        n, p_LE = X_LF[:3, :3] @ n_F, posed.finger_end()[0]
        off = p_LE - apply(X_LF, mark.p_FM[None])[0]
        clearance, nearest = min(near)
        gap = float(n @ off) - posed.finger.radius
        aside = float(np.linalg.norm(off - (n @ off) * n))
        return Executed(aside, gap, clearance, nearest, len(ways))


class _Toucher:
    """One robot before its first mirror, which looks where its finger came to."""

    def __init__(self, known: Knowing, image: BodyImage, station: NicoStation, judge: TouchJudge):
        self._known, self._image, self._station, self._judge = known, image, station, judge
        self._finger: Finger = judge.finger
        model, X_BM = known.robot.model, known.before.views[MIRROR].X_BM
        self._looks = MirrorLooks(station, image, model, model.mirrors[MIRROR], X_BM)
        self._looks.before(known.body.mirror(MIRROR), X_BM)
        known.body.pose(image)

    def go(self, plan: Touch, place: tuple[str, NDArray, NDArray]) -> list[NDArray]:
        """Go a way until the finger is seen where it should be, or has gone often enough.

        Joints are loose: the same readings bring the finger elsewhere each time.

        Args:
            place: Link, and place and normal in its frame.

        Returns:
            How the true joints stood each time, which the robot is not told. Shape (k, n) each.
        """
        body, ways = self._looks.body, []
        for _ in range(TRIES):
            way = []
            for readings in plan.readings[:-1]:
                body.relive(readings)
                way.append(self._stood())
            shot = self._looks.shot(MIRROR, plan.readings[-1])
            ways.append(np.array([*way, self._stood()]))
            if self._seen_off(shot, place) <= SEEN_ON:
                break
        return ways

    def _seen_off(self, shot: Shot, place: tuple[str, NDArray, NDArray]) -> float:
        """Return how far the finger is seen from a place along the surface [m]; 0 if it is not."""
        seen = see_arm(self._image, self._known.body, shot)
        if seen is None:
            return 0.0
        link, p_FM, n_F = place
        servos = self._known.robot.model.servos
        poses = self._image.poses(servos.to_encoder(seen.q[None])[0])
        off = apply(inverse(poses[link]) @ poses[self._finger.link], self._finger.p_FE[None])[0]
        off = off - p_FM
        n = n_F / np.linalg.norm(n_F)
        return float(np.linalg.norm(off - (n @ off) * n))

    def _stood(self) -> NDArray:
        return self._judge.stood(self._station, self._looks.body.context)


def run_touches(
    robots: Sequence[Knowing],
    shapes: Mapping[int, BodyShape],
    marks: MarkStage,
    progress: Stage | None = None,
) -> TouchStage:
    """Let robots touch marks that they have found, and places drawn anywhere.

    Args:
        robots: Who know themselves.
        shapes: Seed of a robot -> what it has learned of head and chest; who is left out plans with
            the description's.
    """
    touched: list[TouchTrial] = []
    plans: list[TouchTrial] = []
    drawn = 0
    for i, known in enumerate(robots):
        seed = known.robot.seed
        nico = rendered(known.robot)
        judge = TouchJudge(nico)
        # Only a mark is worth going nearer to the body than usual.
        planner, usual = (
            TouchPlanner(
                nico.arm, known.robot.model, FINGER,
                held=known.body.angles, X_WB=known.body.X_WB, limits=judge.stops,
                shape=shapes.get(seed), clear=clear,
            )
            for clear in ((WIDE, CLEAR, NARROW), (WIDE, CLEAR))
        )  # fmt: skip
        own = [t for t in marks.trials if t.robot == seed and t.painted.kind == MARK]
        touched += _marks(known, own, planner, judge)
        free_memory()
        some = _plans(seed, len(range(i, PLANS, len(robots))), usual, judge)
        plans += some[0]
        drawn += some[1]
        of_robot(progress, i, len(robots))("touching marks", 1, 1)
    shaped = sum(known.robot.seed in shapes for known in robots)
    return TouchStage(tuple(touched), tuple(plans), drawn, shaped)


def _marks(
    known: Knowing, trials: Sequence[MarkTrial], planner: TouchPlanner, judge: TouchJudge
) -> list[TouchTrial]:
    """Touch the marks that one robot has found."""
    done, robot = [], known.robot
    nico = rendered(robot, ImageQuality())
    with BodyImage(nico.arm, robot.model) as image, NicoStation(
        robot.world, robot.seed, _DAY, arm=nico.arm, quality=nico.quality,
        mirror=known.before.plate,
    ) as station:  # fmt: skip
        toucher = _Toucher(known, image, station, judge)
        for k, trial in enumerate(trials):
            mark, normal = trial.painted.mark, trial.painted.normal
            found = [one for one in trial.found if one.kind == ON_ME]
            if mark is None or normal is None or not found or found[0].p_FM is None:
                continue
            assert found[0].link is not None, "what is on me is on a link"
            place = found[0].link, found[0].p_FM
            rng = np.random.default_rng((robot.seed, 48, k))
            done.append(_touched(toucher, place, (mark, normal), planner, judge, rng))
    return done


def _plans(
    seed: int, count: int, planner: TouchPlanner, judge: TouchJudge
) -> tuple[list[TouchTrial], int]:
    """Touch places until so many ways were found; also how many places were drawn for them."""
    rng = np.random.default_rng((seed, 49))
    done: list[TouchTrial] = []
    drawn = 0
    for link, p_FM in places_near(planner, _POSTURES, rng):
        if len(done) == count:
            break
        drawn += 1
        normal = planner.posed.surfaces[link].normals(p_FM[None])[0]
        plan = planner.at_place(link, p_FM, normal, rng)
        if isinstance(plan, Touch):
            mark = Mark(link, p_FM, DIAMETER, np.ones(3))
            way = judge.go(plan, mark, normal, rng)
            done.append(TouchTrial(0.5 * DIAMETER, True, plan, way))
    return done, drawn


def places_near(
    planner: TouchPlanner, postures: int, rng: np.random.Generator
) -> list[tuple[str, NDArray]]:
    """Return places of head and chest that the finger comes near to in random postures.

    Args:
        postures: How many are drawn, evenly between the joints' limits.

    Returns:
        Links and places [m], shape (3,) each.
    """
    posed = planner.posed
    X_FW = {link: inverse(posed.link_pose(link)) for link in LINKS}
    ends = []
    low, high = planner.reach
    for q in rng.uniform(low, high, (postures, len(low))):
        posed.pose(q)
        ends.append(posed.finger_end()[0])
    found = []
    for link in LINKS:
        surface, p_FE = posed.surfaces[link], apply(X_FW[link], np.array(ends))
        near = p_FE[np.abs(surface.distance(p_FE)) < _NEAR]
        out = near + 2.0 * _NEAR * surface.normals(near)
        for p, way in zip(out, -surface.normals(out), strict=True):
            found += [(link, place) for place in surface.along(p[None], way)]
    return [found[k] for k in rng.permutation(len(found)) if np.isfinite(found[k][1]).all()]


def _touched(
    toucher: _Toucher,
    place: tuple[str, NDArray],
    true: tuple[Mark, NDArray],
    planner: TouchPlanner,
    judge: TouchJudge,
    rng: np.random.Generator,
) -> TouchTrial:
    """Plan a way to a place, go it if there is one, and judge it by the mark that is there."""
    link, p_FM = place
    n_F = planner.posed.surfaces[link].normals(p_FM[None])[0]
    plan = (
        OutOfReach(f"the arm that would touch it carries {link}")
        if link in planner.posed.moving
        else planner.at_place(link, p_FM, n_F, rng)
    )
    mark, normal = true
    exists, done = judge.way_exists(mark, normal, plan, rng), None
    if isinstance(plan, Touch):
        done = judge.gone(toucher.go(plan, (link, p_FM, n_F)), mark, normal)
    return TouchTrial(0.5 * mark.diameter, exists, plan, done)
