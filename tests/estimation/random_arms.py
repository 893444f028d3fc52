"""Random serial arms and recordings of them, sound and faulty, by arithmetic of their own.

Nothing here comes from the package but the form of a data set: the arms that judge the estimators
are moved by other formulas than theirs.
"""

from dataclasses import dataclass, field, replace

import numpy as np

from nico_selfmodel.dataset.dataset import Dataset
from nico_selfmodel.dataset.joint_info import JointInfo

SOUND = ("clean", "joint noise", "high gear")
BENT = ("backlash", "sag", "eccentricity", "coupling")
FAULTS = (
    "encoder jump",
    "marker slip",
    "drift",
    "lag",
    "wrong unit",
    "exchanged columns",
    "foreign marker",
    "repeats",
)
OUTLIERS = ("outliers 5 %", "outliers 20 %", "outliers 40 %")
KINDS = (*SOUND, *BENT, *FAULTS, *OUTLIERS)
UNITS = ("counts", "deg", "rad")


@dataclass(frozen=True, eq=False)
class RandomArm:
    """An arm, its encoders and tracker, and what is imperfect about it."""

    directions: np.ndarray
    points: np.ndarray
    hands: np.ndarray
    low: np.ndarray
    high: np.ndarray
    unit: str
    counts_per_turn: np.ndarray
    gear: np.ndarray
    offset: np.ndarray
    tracker_sigma: float
    joint_sigma: np.ndarray
    backlash: np.ndarray
    sag: np.ndarray
    eccentricity: np.ndarray
    phase: np.ndarray
    coupling: np.ndarray
    masses: np.ndarray = field(default_factory=lambda: np.zeros(0))

    @property
    def reach(self):
        """Length of the arm stretched out [m]."""
        links = np.diff(np.vstack([self.points, self.hands[:1]]), axis=0)
        return float(np.linalg.norm(links, axis=1).sum())

    def frames(self, q):
        """Return rotation and place of what each joint carries. Shapes (n, N, 3, 3), (n, N, 3)."""
        rotation, place = np.tile(np.eye(3), (len(q), 1, 1)), np.zeros((len(q), 3))
        turned, placed = [], []
        for d, c, angle in zip(self.directions, self.points, q.T, strict=True):
            k = np.array([[0, -d[2], d[1]], [d[2], 0, -d[0]], [-d[1], d[0], 0]])
            own = np.eye(3) + np.sin(angle)[:, None, None] * k
            own = own + (1.0 - np.cos(angle))[:, None, None] * (k @ k)
            place = place + np.einsum("nij,nj->ni", rotation, c - own @ c)
            rotation = rotation @ own
            turned.append(rotation)
            placed.append(place)
        return np.stack(turned), np.stack(placed)

    def hand(self, q, marker, link=None):
        """Return where markers are [m]; `link` carries them, the last one if omitted. (N, 3)."""
        rotation, place = (part[-1 if link is None else link] for part in self.frames(q))
        return np.einsum("nij,nj->ni", rotation, self.hands[marker]) + place

    def bent(self, q, approach):
        """Return the joint angles that the arm takes where a rigid one would take q."""
        bent = q + self.backlash * approach + q @ self.coupling.T
        bent = bent + self.eccentricity * (np.sin(q + self.phase) - np.sin(self.phase))
        if not self.sag.any():
            return bent
        rotation, place = self.frames(q)
        centres = 0.5 * (self.points + np.vstack([self.points[1:], self.hands[:1]]))
        middle = np.einsum("inab,ib->ina", rotation, centres) + place
        first = np.concatenate([np.tile(np.eye(3), (1, len(q), 1, 1)), rotation[:-1]])
        start = np.concatenate([np.zeros((1, len(q), 3)), place[:-1]])
        for i in range(len(self.sag)):
            axis = first[i] @ self.directions[i]
            at = first[i] @ self.points[i] + start[i]
            arm = np.einsum("j,jna->na", self.masses[i:], middle[i:]) - self.masses[i:].sum() * at
            moment = np.cross(arm, [0.0, 0.0, -1.0])
            bent[:, i] += self.sag[i] * np.sum(axis * moment, axis=1)
        return bent

    def readings(self, q):
        """Return what the encoders say, rounded as they round."""
        angle = self.offset + self.gear * q
        if self.unit == "counts":
            return np.round(angle * self.counts_per_turn / (2.0 * np.pi))
        return np.degrees(angle) if self.unit == "deg" else angle

    def angles(self, readings):
        """Return the joint angles that readings mean."""
        by_unit = {"counts": 2.0 * np.pi / self.counts_per_turn, "deg": np.pi / 180.0, "rad": 1.0}
        return (readings * by_unit[self.unit] - self.offset) / self.gear


def random_arm(rng, kind="clean"):
    """Draw an arm with the imperfections of a kind."""
    n, m = int(rng.integers(2, 8)), int(rng.integers(1, 4))
    if kind in ("marker slip", "foreign marker"):
        m = max(m, 2)
    directions, points = _axes(rng, n)
    hands = _hands(rng, directions[-1], points[-1], m)
    span = np.radians(rng.uniform(70.0, 280.0, n))
    middle = rng.uniform(-1.0, 1.0, n)
    unit = "counts" if kind == "high gear" else str(rng.choice(UNITS))
    gear = np.ones(n)
    if unit == "counts":
        low, high = (20.0, 200.0) if kind == "high gear" else (0.5, 20.0)
        gear = np.exp(rng.uniform(np.log(low), np.log(high), n))
    none = np.zeros(n)
    reach = np.linalg.norm(np.diff(np.vstack([points, hands[:1]]), axis=0), axis=1).sum()
    tracker = reach * np.exp(rng.uniform(np.log(5e-5), np.log(1e-3)))
    arm = RandomArm(
        directions, points, hands, middle - span / 2, middle + span / 2, unit,
        np.exp2(rng.integers(12, 20, n)), gear, rng.uniform(-3.0, 3.0, n), float(tracker),
        none, none, none, none, rng.uniform(0.0, 2.0 * np.pi, n), np.zeros((n, n)),
        rng.uniform(0.5, 1.5, n),
    )  # fmt: skip
    return _imperfect(rng, arm, kind)


def _imperfect(rng, arm, kind):
    n = len(arm.gear)
    if kind == "joint noise":
        return replace(arm, joint_sigma=np.full(n, np.radians(rng.uniform(0.03, 0.3))))
    if kind == "backlash":
        return replace(arm, backlash=np.radians(rng.uniform(0.05, 0.5, n)))
    if kind == "eccentricity":
        size = np.radians(rng.uniform(0.2, 3.0, n))
        return replace(arm, eccentricity=size * (rng.random(n) < 0.7))
    if kind == "coupling":
        pairs = rng.uniform(-0.02, 0.02, (n, n)) * (rng.random((n, n)) < 0.5)
        return replace(arm, coupling=pairs * ~np.eye(n, dtype=bool))
    if kind == "sag":
        # At most so much at the joint, stretched out.
        weight = arm.reach * arm.masses.sum()
        return replace(arm, sag=np.radians(rng.uniform(0.1, 1.5, n)) / weight)
    return arm


def _axes(rng, n):
    """Axes whose neighbours are parallel, nearly so, crossing at a right angle, or anyhow."""
    directions, points = np.zeros((n, 3)), np.zeros((n, 3))
    directions[0] = _unit(np.array([0.0, 0.0, 1.0]) + 0.3 * rng.normal(size=3))
    points[0] = rng.uniform(-0.3, 0.3, 3)
    lengths = rng.uniform(0.08, 0.4, n)
    parallel_before = False
    for i in range(1, n):
        kind = rng.choice(4, p=[0.2, 0.1, 0.4, 0.3])
        if parallel_before and kind < 2:
            kind = 2
        d = directions[i - 1]
        side = _unit(np.cross(d, rng.normal(size=3)))
        parallel_before = kind < 2
        if kind == 0:
            directions[i] = d
        elif kind == 1:
            directions[i] = _unit(d + np.radians(rng.uniform(0.0, 6.0)) * side)
        elif kind == 2:
            directions[i] = side
        else:
            directions[i] = _unit(rng.normal(size=3))
        step = _unit(np.cross(directions[i], rng.normal(size=3))) * lengths[i]
        crossing = rng.random() < 0.4 and not parallel_before
        points[i] = points[i - 1] + (lengths[i] * d if crossing else step)
    return directions, points


def _hands(rng, d, c, m):
    """Markers 5 to 25 cm off the last axis."""
    side = _unit(np.cross(d, rng.normal(size=3)))
    first = c + side * rng.uniform(0.08, 0.25) + d * rng.uniform(-0.1, 0.1)
    others = first + rng.uniform(-0.04, 0.04, (m - 1, 3))
    return np.vstack([first[None], others])


def _unit(v):
    return v / np.linalg.norm(v)


@dataclass(frozen=True, eq=False)
class Recording:
    """What was recorded of an arm, and fresh poses of the sound one."""

    kind: str
    seed: int
    arm: RandomArm
    dataset: Dataset
    sound: Dataset
    """The same set without the fault."""
    readings: np.ndarray
    """500 fresh poses in the trained range."""
    p_WH: np.ndarray
    """Measured there, marker 0. Shape (500, 3)."""
    p_WH_exact: np.ndarray
    """Where a rigid arm has it at the angles that the readings mean. Shape (500, 3)."""


def random_recording(kind, seed, fresh=500):
    """Draw an arm and record it.

    Args:
        kind: One of `KINDS`.
        seed: Everything about it.
        fresh: Poses to judge by.
    """
    rng = np.random.default_rng([KINDS.index(kind), seed])
    arm = random_arm(rng, kind)
    n, unknowns = len(arm.gear), 5 * len(arm.gear) + 3 * len(arm.hands)
    count = int(rng.integers(max(40, unknowns), 160))
    q, sweep = _poses(rng, arm, count, kind)
    noise = np.random.default_rng([KINDS.index(kind), seed, 1])
    sound, dataset = _recorded(arm, q, sweep, kind, noise)
    inside = q[sweep == ""] if (sweep == "").sum() > 5 else q
    q_fresh = rng.uniform(inside.min(axis=0), inside.max(axis=0), (fresh, n))
    approach = np.sign(np.diff(q_fresh, axis=0, prepend=inside[-1:]))
    true = arm.bent(q_fresh, approach) + arm.joint_sigma * rng.normal(size=(fresh, n))
    first = np.zeros(fresh, dtype=int)
    p = arm.hand(true, first) + arm.tracker_sigma * rng.normal(size=(fresh, 3))
    readings = arm.readings(q_fresh)
    exact = arm.hand(arm.angles(readings), first)
    return Recording(kind, seed, arm, dataset, sound, readings, p, exact)


def _poses(rng, arm, count, kind):
    """Free poses, in half of the cases after sweeps about a home; a path where time counts."""
    n = len(arm.gear)
    q = rng.uniform(arm.low, arm.high, (count, n))
    sweep = np.full(count, "", dtype="U8")
    if kind == "lag" or (kind == "drift" and rng.random() < 0.3):
        knots = rng.uniform(arm.low, arm.high, (count // 8 + 4, n))
        at = np.linspace(1.0, len(knots) - 2.001, count)
        k, s = at.astype(int), (at - at.astype(int))[:, None]
        a, b, c, d = (knots[k + i] for i in (-1, 0, 1, 2))
        q = 0.5 * (2 * b + (c - a) * s + (2 * a - 5 * b + 4 * c - d) * s**2
                   + (3 * b - a - 3 * c + d) * s**3)  # fmt: skip
    elif kind == "repeats":
        times = int(rng.integers(3, 11))
        q = np.repeat(rng.uniform(arm.low, arm.high, (count // times + 4, n)), times, axis=0)
        sweep = np.full(len(q), "", dtype="U8")
    elif rng.random() < 0.5:
        home, each = 0.5 * (arm.low + arm.high), int(rng.integers(6, 16))
        swept = np.tile(home, (n * each + 1, 1))
        names = np.array(["home"] + [f"j{i}" for i in range(n) for _ in range(each)])
        for i in range(n):
            swept[1 + i * each : 1 + (i + 1) * each, i] = np.linspace(arm.low[i], arm.high[i], each)
        q, sweep = np.vstack([swept, q]), np.concatenate([names, sweep])
    return q, sweep


def _recorded(arm, q, sweep, kind, rng):
    """Return the sound data set and the faulty one."""
    n, m, count = len(arm.gear), len(arm.hands), len(q)
    approach = np.sign(np.diff(q, axis=0, prepend=q[:1] - 1e-3 * rng.normal(size=(1, n))))
    for k in range(1, count):  # who stands still is where the last motion left it
        approach[k] = np.where(approach[k] == 0.0, approach[k - 1], approach[k])
    joint = arm.joint_sigma * rng.normal(size=q.shape)
    if kind == "repeats":
        # Frames of a standing arm share what its joints are off by.
        moved = np.r_[True, (np.diff(q, axis=0) != 0.0).any(axis=1)]
        stand = np.maximum.accumulate(np.where(moved, np.arange(count), 0))
        joint = np.radians(rng.uniform(0.1, 0.4)) * rng.normal(size=q.shape)[stand]
    true = arm.bent(q, approach) + joint
    markers = np.repeat(np.arange(m)[None], count, axis=0)
    noise = arm.tracker_sigma * rng.normal(size=(count, m, 3))
    p = np.stack([arm.hand(true, markers[:, k]) for k in range(m)], axis=1) + noise
    readings = arm.readings(q)
    sound = _dataset(arm, readings, p, sweep)
    readings, p, unit = _faulty(arm, q, true, readings, p, noise, kind, rng)
    faulty = _dataset(arm, readings, p, sweep, unit)
    return sound, faulty


def _faulty(arm, q, true, readings, p, noise, kind, rng):
    n, m, count = len(arm.gear), len(arm.hands), len(q)
    half = int(count * rng.uniform(0.35, 0.65))
    size, unit = arm.reach, None
    readings, p = readings.copy(), p.copy()
    if kind == "encoder jump":
        i = rng.integers(n)
        by = arm.readings(np.full((1, n), np.radians(rng.uniform(1.0, 10.0)) * rng.choice([-1, 1])))
        readings[half:, i] += (by - arm.readings(np.zeros((1, n))))[0, i]
    elif kind == "marker slip":
        shift, k = _unit(rng.normal(size=3)) * size * rng.uniform(0.003, 0.02), rng.integers(m)
        moved = replace(arm, hands=arm.hands + shift * (np.arange(m) == k)[:, None])
        p[half:, k] = (moved.hand(true, np.full(count, k)) + noise[:, k])[half:]
    elif kind == "drift":
        way = _unit(rng.normal(size=3)) * size * rng.uniform(0.005, 0.03)
        p += (np.linspace(0.0, 1.0, count)[:, None] * way)[:, None]
    elif kind == "lag":
        # The tracker is late by a part of a sample or some samples.
        late = rng.uniform(0.3, 2.5)
        at = np.arange(count) - late
        delayed = np.stack([np.interp(at, np.arange(count), true[:, i]) for i in range(n)], axis=1)
        p = np.stack([arm.hand(delayed, np.full(count, i)) for i in range(m)], axis=1) + noise
    elif kind == "wrong unit" and arm.unit == "counts":
        # Some of the rows of one joint were read at another resolution.
        high = q[:, 0] > np.median(q[:, 0])
        readings[:, 0] = np.where(high, 2.0 * readings[:, 0], readings[:, 0])
    elif kind == "wrong unit":
        unit = "deg" if arm.unit == "rad" else "rad"
    elif kind == "exchanged columns":
        i = int(rng.integers(n - 1))
        readings[:, [i, i + 1]] = readings[:, [i + 1, i]]
    elif kind == "foreign marker":
        k, link = int(rng.integers(1, m)), int(rng.integers(0, n - 1))
        p[:, k] = arm.hand(true, np.full(count, k), link) + noise[:, k]
    elif kind.startswith("outliers"):
        wrong = rng.random((count, m)) < float(kind.split()[1]) / 100.0
        ways = rng.normal(size=(int(wrong.sum()), 3))
        ways /= np.linalg.norm(ways, axis=1, keepdims=True)
        p[wrong] += size * rng.uniform(0.05, 0.5, (len(ways), 1)) * ways
    return readings, p, unit


def _dataset(arm, readings, p, sweep, unit=None):
    n, (count, m), unit = len(arm.gear), p.shape[:2], unit or arm.unit
    turns = arm.counts_per_turn.tolist() if unit == "counts" else [None] * n
    joints = tuple(JointInfo(f"j{i}", unit, turns[i]) for i in range(n))
    rows = np.repeat(np.arange(count), m)
    return Dataset(
        "set",
        joints,
        rows,
        readings[rows],
        p.reshape(-1, 3),
        sweep=sweep[rows].astype(str),
        marker=np.tile([f"m{k}" for k in range(m)], count),
    )
