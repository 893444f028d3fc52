"""A simulated arm before mirrors, watched by a pair of eyes; nothing rendered, the truth hidden."""

from collections.abc import Mapping

import numpy as np
from numpy.typing import ArrayLike, NDArray

from nico_selfmodel.dataset import BoardViews, Dataset, JointInfo
from nico_selfmodel.geometry.rotation import move_on_sphere, rotation_from_vector, tangent_basis
from nico_selfmodel.geometry.transform import apply, transform
from nico_selfmodel.model import Camera, Chain, DhTable, Mirror, SelfModel, ServoMap, StereoRig
from nico_selfmodel.model.mirror_rig import MirrorRig
from nico_selfmodel.systems.curved_mirror import curved_reflection
from nico_selfmodel.systems.simulated_eyes import NICO_CAMERAS

_MARGIN = 5.0
"""Markers nearer to the image's edge are not found [px]."""
_TRIES = 4000
"""Poses tried for each one that shows what is wanted."""
_COUNTS_PER_TURN = 16384


class SimulatedMirrors:
    """An arm, two eyes and mirrors; pixels come from the true ones, exactly, with noise added.

    The true arm, eyes and mirrors are private. `calibrated` gives them away, without the mirrors:
    it is the body that has learned all else without error.
    """

    def __init__(
        self,
        nominal: Chain,
        limits: tuple[ArrayLike, ArrayLike],
        mirrors: Mapping[str, Mirror],
        seed: int,
        *,
        pixel_sigma: float = 0.3,
        play: float = np.radians(0.5),
        radius: float | None = None,
        clearance: float = 0.05,
    ) -> None:
        """Build one individual and put mirrors before it, each a little off from where intended.

        Args:
            nominal: The arm as described, in the left eye's frame.
            limits: Lower and upper joint limits [rad]. Shape (n,) each.
            mirrors: Where the mirrors are meant to stand.
            seed: Of the individual.
            pixel_sigma: Noise of each pixel coordinate [px].
            play: Half the width of the joints' play [rad].
            radius: Radius of curvature of the mirrors [m], positive bulging towards the eyes; flat
                if omitted.
            clearance: How far the hand keeps from the glass [m].
        """
        rng = np.random.default_rng((seed, 11))
        self.pixel_sigma, self.play, self.clearance = pixel_sigma, play, clearance
        self._seed, self._radius = seed, radius
        self._limits = np.array([np.asarray(limit, dtype=float) for limit in limits])
        self.__chain = _individual_arm(nominal, rng)
        n = len(nominal.joints)
        self.__servos = ServoMap(
            nominal.joints,
            offset=rng.uniform(-1.0, 1.0, n),
            gear=1.0 + 0.01 * rng.normal(size=n),
            unit=("counts",) * n,
            counts_per_turn=np.full(n, float(_COUNTS_PER_TURN)),
            sign=np.ones(n),
        )
        self.__rig = StereoRig(
            _individual_eye(NICO_CAMERAS.left, rng, 0.0),
            _individual_eye(NICO_CAMERAS.right, rng, 1.0),
        )
        spread = [np.radians(2.0), np.radians(2.0), 5e-3]
        self.__mirrors = {
            name: Mirror.from_values(mirror.values + rng.normal(0.0, spread))
            for name, mirror in mirrors.items()
        }

    @property
    def joints(self) -> tuple[JointInfo, ...]:
        """Names, units and stops of the joints, as a data set states them."""
        stops = np.sort(self.__servos.to_encoder(self._limits), axis=0)
        return tuple(
            JointInfo(name, "counts", counts_per_turn=_COUNTS_PER_TURN, lower=low, upper=high)
            for name, low, high in zip(
                self.__servos.joints, np.ceil(stops[0]), np.floor(stops[1]), strict=True
            )
        )

    def watch(self, mirror: str, count: int, session: int = 0, name: str = "mirror") -> Dataset:
        """Move to random poses whose reflection both eyes see, and return what they saw.

        Args:
            mirror: Name of the mirror; empty for the hand seen directly.
            count: Number of poses.
            session: Of poses and noise.
            name: Of the data set.

        Returns:
            Encoders and pixels.

        Raises:
            ValueError: If there is no such mirror, or hardly a pose shows the hand in it.
        """
        if mirror and mirror not in self.__mirrors:
            raise ValueError(f"no mirror {mirror!r}; there are {', '.join(self.__mirrors)}")
        rng = np.random.default_rng((self._seed, session, len(mirror), 12))
        encoders, pixels = np.zeros((0, len(self.joints))), np.zeros((0, 4))
        for _ in range(_TRIES):
            q = rng.uniform(*self._limits, (max(count, 50), len(self.joints)))
            commands = np.round(self.__servos.to_encoder(q))
            seen = self._see(mirror, commands, rng)
            shown = np.isfinite(seen).all(axis=1)
            encoders = np.concatenate([encoders, commands[shown]])
            pixels = np.concatenate([pixels, seen[shown]])
            if len(encoders) >= count:
                break
        else:
            raise ValueError(f"hardly any pose shows the hand in {mirror or 'the eyes'!r}")
        return self._dataset(mirror, encoders[:count], pixels[:count], name)

    def move_and_measure(self, mirror: str, encoders: ArrayLike, session: int = 0) -> NDArray:
        """Return what the eyes see of chosen poses, nan where they do not see the hand.

        Args:
            mirror: Name of the mirror; empty for the hand seen directly.
            encoders: Readings [counts]. Shape (N, n).
            session: Of play and noise.

        Returns:
            Pixels. Shape (N, 4).
        """
        rng = np.random.default_rng((self._seed, session, 13))
        return self._see(mirror, np.asarray(encoders, dtype=float), rng)

    def look_at_boards(self, p_GQ: NDArray, count: int, session: int = 0) -> BoardViews:
        """Hold a board before the eyes in random attitudes and return where its corners are seen.

        Args:
            p_GQ: Corners of the board [m]. Shape (P, 3).
            count: How many views.
            session: Of attitudes and noise.

        Returns:
            Views in which both eyes see all corners.
        """
        rng = np.random.default_rng((self._seed, session, 14))
        centered, seen = p_GQ - p_GQ.mean(axis=0), []
        while len(seen) < count:
            depth = rng.uniform(0.22, 0.5)
            aside = rng.uniform(-0.5, 0.5, 2) * depth + [0.035, 0.0]
            pose = transform(rotation_from_vector(rng.normal(0.0, 0.4, 3)), [*aside, depth])
            pixels = self.__rig.project(apply(pose, centered))
            if self._inside(pixels).all():
                seen.append(pixels + rng.normal(0.0, 0.5 * self.pixel_sigma, pixels.shape))
        names = tuple(f"{i + 1:02d}" for i in range(count))
        size = self.__rig.left.image_size
        return BoardViews(p_GQ, names, ("left", "right"), np.array(seen), size)

    def calibrated(self) -> SelfModel:
        """Return the body that knows its arm and eyes without error, and no mirror."""
        # Play that is uniform within +-p has the standard deviation p / sqrt 3.
        table = DhTable.from_chain(self.__chain)
        q = np.random.default_rng(0).uniform(*self._limits, (200, len(self.joints)))
        lever = _levers(self.__chain, q)
        return SelfModel(
            f"calibrated body {self._seed}",
            table,
            self.__servos,
            noise_sigma=lever * self.play / np.sqrt(3.0),
            cameras={"left": self.__rig.left, "right": self.__rig.right},
            pixel_sigma=self.pixel_sigma,
        )

    def true_mirror(self, mirror: str) -> Mirror:
        """Return where a mirror really stands; for judging, not for learning."""
        return self.__mirrors[mirror]

    def _see(self, mirror: str, encoders: NDArray, rng: np.random.Generator) -> NDArray:
        """Return noisy pixels of poses, nan where an eye does not see the hand. Shape (N, 4)."""
        q = self.__servos.to_joint(encoders)
        p = self.__chain.forward(q + rng.uniform(-1.0, 1.0, q.shape) * self.play)
        pixels = self._reflect(self.__mirrors[mirror], p) if mirror else self.__rig.project(p)
        noisy = pixels + rng.normal(0.0, self.pixel_sigma, pixels.shape)
        return np.where(self._inside(noisy)[:, None], noisy, np.nan)

    def _reflect(self, mirror: Mirror, p: NDArray) -> NDArray:
        """Return exact pixels of reflections of what keeps clear of the glass. Shape (N, 4)."""
        if self._radius is None:
            pixels = MirrorRig(self.__rig, mirror).project(p)
        else:
            eyes = self.__rig.eyes
            pixels = np.concatenate(
                [curved_reflection(eye, mirror, self._radius, p, eye.X_WC) for eye in eyes], axis=1
            )
        return np.where((mirror.in_front_by(p) > self.clearance)[:, None], pixels, np.nan)

    def _inside(self, pixels: NDArray) -> NDArray:
        """Return which rows lie well inside both images. Shape (N, 4) -> (N,)."""
        limit = np.tile(self.__rig.left.image_size, 2) - 1.0 - _MARGIN
        return np.asarray(((pixels > _MARGIN) & (pixels < limit)).all(axis=1))

    def _dataset(self, mirror: str, encoders: NDArray, pixels: NDArray, name: str) -> Dataset:
        """Lay poses out as rows."""
        kind = "flat" if self._radius is None else f"curved, radius {self._radius:g} m"
        return Dataset(
            name,
            self.joints,
            np.arange(1, len(encoders) + 1),
            encoders,
            pixels=pixels,
            mirror=np.full(len(encoders), mirror),
            marker=np.full(len(encoders), self.__chain.markers[0]),
            pixel_sigma_px=self.pixel_sigma,
            image_size=self.__rig.left.image_size,
            source=f"simulated, individual {self._seed}, mirror {kind}",
            seed=self._seed,
        )


def _individual_arm(nominal: Chain, rng: np.random.Generator) -> Chain:
    """Return the arm as it was really built: axes within 1.5 deg and 2 mm."""
    n, m = len(nominal.joints), len(nominal.markers)
    directions = move_on_sphere(nominal.directions, rng.normal(0.0, np.radians(1.5), (n, 2)))[0]
    shift = np.einsum(
        "nij,nj->ni", tangent_basis(nominal.directions), rng.normal(0.0, 2e-3, (n, 2))
    )
    return Chain(
        nominal.joints,
        directions / np.linalg.norm(directions, axis=1, keepdims=True),
        nominal.points + shift,
        nominal.markers,
        nominal.p_WH_zero + rng.normal(0.0, 2e-3, (m, 3)),
    )


def _individual_eye(nominal: Camera, rng: np.random.Generator, placed: float) -> Camera:
    """Return an eye as it was really built; the left one is the world, so it is placed exactly."""
    spread = np.array([4.0, 4.0, 0.0, 8.0, 8.0, 0.02, 0.01, 0.002, 0.0, 0.0])
    turn = rotation_from_vector(placed * rng.normal(0.0, np.radians(1.0), 3))
    pose = nominal.X_WC @ transform(turn, placed * rng.normal(0.0, 1e-3, 3))
    values = nominal.values + spread * rng.normal(size=len(spread))
    return Camera.from_values(values, nominal.image_size, pose)


def _levers(chain: Chain, q: NDArray) -> float:
    """Return what one radian of play in every joint does to a coordinate of the hand, rms [m]."""
    step = 1e-6
    moved = [chain.forward(q + step * axis) - chain.forward(q) for axis in np.eye(q.shape[1])]
    return float(np.sqrt(np.sum(np.square(moved)) / (3.0 * len(q)))) / step
