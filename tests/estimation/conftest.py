"""Arms whose truth is known, and the data sets that they record."""

from dataclasses import dataclass, replace

import numpy as np
import pytest
from numpy.typing import NDArray

from nico_selfmodel.dataset.dataset import Dataset
from nico_selfmodel.dataset.joint_info import JointInfo
from nico_selfmodel.geometry.rotation import rotation_about
from nico_selfmodel.model.arm.chain import Chain
from nico_selfmodel.model.arm.servo_map import ServoMap
from nico_selfmodel.model.self_model import SelfModel

from .joined_data import joined_data

COUNTS = 10000.0
_ELBOW = np.eye(3)[[2, 1, 0, 1, 0, 1, 2]]
_PARALLEL = np.eye(3)[[2, 1, 1, 1, 2, 1, 0]]


@dataclass(frozen=True, eq=False)
class Truth:
    """An arm as it is, which no learner is shown."""

    chain: Chain
    servos: ServoMap

    def poses(self, count: int, seed: int = 0, span: float = 2.0) -> NDArray:
        """Return random joint angles within a span about zero."""
        rng = np.random.default_rng(seed)
        return rng.uniform(-0.5 * span, 0.5 * span, (count, len(self.chain.joints)))

    def sweeps(self, points: int, arc: float = 1.6, home: NDArray | None = None) -> tuple:
        """Return joint angles and labels of a circle a joint, `points` with home on each."""
        n = len(self.chain.joints)
        home = np.zeros(n) if home is None else home
        share = (np.arange(points - 1) + 0.5) / (points - 1) - 0.5
        circles = home + np.einsum("ij,k->ikj", np.eye(n), arc * share)
        labels = ["home", *np.repeat(self.chain.joints, points - 1).tolist()]
        return np.vstack([home, circles.reshape(-1, n)]), labels

    def dataset(
        self,
        q: NDArray,
        sweep: list[str] | None = None,
        *,
        sigma: float = 0.0,
        missing: float = 0.0,
        outliers: float = 0.0,
        seed: int = 0,
        known_sigma: bool = False,
    ) -> Dataset:
        """Record every marker at joint angles, with noise, lost markers and gross outliers."""
        rng = np.random.default_rng((seed, 77))
        n, m = len(self.chain.joints), len(self.chain.markers)
        marker = np.tile(np.arange(m), len(q))
        q_rows = np.repeat(q, m, axis=0)
        p = self.chain.forward(q_rows, marker) + sigma * rng.normal(size=(len(q_rows), 3))
        wrong = rng.choice(len(p), round(outliers * len(p)), replace=False)
        p[wrong] += 0.05 * rng.normal(size=(len(wrong), 3))
        p[rng.random(len(p)) < missing] = np.nan
        labels = np.repeat(np.array([""] * len(q) if sweep is None else sweep), m)
        return Dataset(
            name="truth",
            joints=self.joint_infos,
            sample=np.repeat(np.arange(1, len(q) + 1), m),
            encoders=self.servos.to_encoder(q_rows).reshape(-1, n),
            p_WH_measured=p,
            sweep=labels,
            marker=np.array(self.chain.markers)[marker],
            point_sigma_m=sigma if known_sigma else None,
        )

    @property
    def joint_infos(self) -> tuple[JointInfo, ...]:
        """The joints as a data set states them."""
        return tuple(
            JointInfo(name, unit, COUNTS if unit == "counts" else None, sign=int(sign))
            for name, unit, sign in zip(
                self.chain.joints, self.servos.unit, self.servos.sign, strict=True
            )
        )

    def errors(self, model: SelfModel, q: NDArray) -> NDArray:
        """Return the distances of predicted from true points, all markers [m]."""
        readings = self.servos.to_encoder(q)
        return np.concatenate(
            [
                np.linalg.norm(
                    model.predict(readings, name).p_WH - self.chain.forward(q, k), axis=1
                )
                for k, name in enumerate(self.chain.markers)
            ]
        )


def random_chain(n: int, markers: int, kind: str, rng: np.random.Generator) -> Chain:
    """Return an arm of about half a metre whose every circle about zero has a radius of 6 cm."""
    for _ in range(1000):
        outlying = rng.normal(size=(n, 3))
        base = {"outlying": outlying, "elbow": _ELBOW[:n], "parallel": _PARALLEL[:n]}[kind]
        directions = base + (0.0 if kind == "outlying" else 0.005 * outlying)
        directions = directions / np.linalg.norm(directions, axis=1, keepdims=True)
        points = np.cumsum(rng.normal(0.0, 0.12, (n, 3)), axis=0)
        hands = points[-1] + rng.normal(0.0, 0.12, (markers, 3))
        radii = np.linalg.norm(np.cross(hands[:, None] - points, directions), axis=2)
        if radii.min() > 0.06:
            names = tuple(f"joint_{i}" for i in range(n))
            return Chain(names, directions, points, ("hand", "thumb", "wrist")[:markers], hands)
    raise AssertionError("no such arm found")


@pytest.fixture(scope="session")
def make_truth():
    """Return a function: joints, seed, unit, kind, markers -> an arm that is known."""

    def make(
        n: int, seed: int = 0, *, unit: str = "rad", kind: str = "outlying", markers: int = 1
    ) -> Truth:
        rng = np.random.default_rng((n, seed))
        chain = random_chain(n, markers, kind, rng)
        counts = unit == "counts"
        servos = ServoMap(
            chain.joints,
            offset=rng.uniform(-1.0, 1.0, n) if counts else rng.uniform(-0.3, 0.3, n),
            gear=rng.uniform(0.7, 1.8, n) if counts else np.ones(n),
            unit=(unit,) * n,
            counts_per_turn=np.full(n, COUNTS if counts else np.nan),
            sign=rng.choice([-1.0, 1.0], n),
        )
        return Truth(chain, servos)

    return make


@pytest.fixture(scope="session")
def joined():
    """Return a function that puts data sets of one arm together."""

    return joined_data


@pytest.fixture(scope="session")
def hand_on_last_axis():
    """Return a function that puts the tracked points a distance off the last axis."""

    def move(truth: Truth, off: float) -> Truth:
        chain = truth.chain
        d, c = chain.directions[-1], chain.points[-1]
        aside = np.cross(d, chain.directions[-2])
        aside /= np.linalg.norm(aside)
        turns = rotation_about(d, np.linspace(0.0, 2.0, len(chain.markers)))
        hands = c + 0.15 * d + off * turns @ aside
        return replace(truth, chain=replace(chain, p_WH_zero=hands))

    return move
