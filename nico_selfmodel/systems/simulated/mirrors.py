"""A simulated robot before mirrors; nothing rendered, the truth hidden."""

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from nico_selfmodel.dataset.board_views import BoardViews
from nico_selfmodel.dataset.dataset import Dataset
from nico_selfmodel.dataset.joint_info import JointInfo
from nico_selfmodel.model.arm.chain import Chain
from nico_selfmodel.model.cameras.mirror import Mirror
from nico_selfmodel.model.cameras.mirror_rig import MirrorRig
from nico_selfmodel.model.cameras.stereo_rig import StereoRig
from nico_selfmodel.model.self_model import SelfModel
from nico_selfmodel.names import refuse_unknown
from nico_selfmodel.systems.nico_cameras import NICO_CAMERAS
from nico_selfmodel.systems.simulated.cameras import built_camera, inside_images, views_of_boards
from nico_selfmodel.systems.simulated.curved_mirror import curved_reflection
from nico_selfmodel.systems.simulated.ground_truth import GroundTruth
from nico_selfmodel.systems.simulated.imperfections import Imperfections
from nico_selfmodel.systems.simulated.instance import RobotInstance
from nico_selfmodel.systems.simulated.mechanics import Mechanics

if TYPE_CHECKING:
    # The plant is slow to load.
    from nico_selfmodel.plant import ArmDescription

_EDGE = 5.0
"""Markers nearer to the image's edge are not found [px]."""
_CLEARANCE = 0.05
"""How far the hand keeps from the glass [m]."""
_TRIES = 4000
"""Poses tried for each one that shows what is wanted."""


class SimulatedMirrors:
    """An arm, two cameras and mirrors; exact pixels of the true ones, with noise added.

    `calibrated` gives arm and cameras away, without the mirrors: it is the robot that has learned
    all else without error. The rest of the truth stands behind `ground_truth`.
    """

    def __init__(
        self,
        arm: "ArmDescription",
        mirrors: Mapping[str, Mirror],
        seed: int,
        *,
        pixel_sigma: float = 0.3,
        play: float = np.radians(0.5),
        radius: float | None = None,
    ) -> None:
        """Build one robot and put mirrors before it, each a little off from where intended.

        Args:
            arm: The arm as described, its chain in the left camera's frame.
            mirrors: Where the mirrors are meant to stand.
            seed: Which robot.
            pixel_sigma: Noise of each pixel coordinate [px].
            play: Half the width of the joints' noise [rad].
            radius: Radius of curvature of the mirrors [m], positive bulging towards the cameras;
                flat if omitted.
        """
        rng = np.random.default_rng((seed, 11))
        self.pixel_sigma, self.play = pixel_sigma, play
        self._seed, self._radius = seed, radius
        self._limits = arm.lower, arm.upper
        flaws = Imperfections("before mirrors", extra_gear=1.0, stop_spread=0.0, play=play)
        self.__mechanics = Mechanics.build(arm, flaws, seed, rng)
        # The left camera is the world.
        left = built_camera(NICO_CAMERAS.left, rng).at(NICO_CAMERAS.left.X_WC)
        self.__rig = StereoRig(left, built_camera(NICO_CAMERAS.right, rng))
        spread = [np.radians(2.0), np.radians(2.0), 5e-3]
        self.__mirrors = {
            name: Mirror.from_values(mirror.values + rng.normal(0.0, spread))
            for name, mirror in mirrors.items()
        }

    @property
    def joints(self) -> tuple[JointInfo, ...]:
        """Names, units and stops of the joints, as a data set states them."""
        return self.__mechanics.joints

    @property
    def ground_truth(self) -> GroundTruth:
        """What only the simulation knows: for judging and for tests, never for learning."""
        robot = RobotInstance(self.__mechanics, self.__rig, np.eye(4))
        return GroundTruth(robot, mirrors=self.__mirrors)

    def watch(self, mirror: str, count: int, session: int = 0, name: str = "mirror") -> Dataset:
        """Move to random poses whose reflection both cameras see, and return what they saw.

        Args:
            mirror: Name of the mirror; empty for the hand seen directly.
            session: Of poses and noise.

        Returns:
            Encoders and pixels.

        Raises:
            ValueError: If there is no such mirror, or hardly a pose shows the hand in it.
        """
        if mirror:
            refuse_unknown("mirror", mirror, self.__mirrors)
        rng = np.random.default_rng((self._seed, session, len(mirror), 12))
        encoders, pixels = np.zeros((0, len(self.joints))), np.zeros((0, 4))
        for _ in range(_TRIES):
            q = rng.uniform(*self._limits, (max(count, 50), len(self.joints)))
            commands = np.round(self.__mechanics.servos.to_encoder(q))
            seen = self._see(mirror, commands, rng)
            shown = np.isfinite(seen).all(axis=1)
            encoders = np.concatenate([encoders, commands[shown]])
            pixels = np.concatenate([pixels, seen[shown]])
            if len(encoders) >= count:
                return self._dataset(mirror, encoders[:count], pixels[:count], name)
        raise ValueError(f"hardly any pose shows the hand in {mirror or 'the cameras'!r}")

    def move_and_measure(self, mirror: str, encoders: ArrayLike, session: int = 0) -> NDArray:
        """Return what the cameras see of chosen poses, nan where they do not see the hand.

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
        """Hold a board before the cameras; see `SimulatedCameras.look_at_boards`."""
        rng = np.random.default_rng((self._seed, session, 14))
        return views_of_boards(self.__rig, p_GQ, count, rng, 0.5 * self.pixel_sigma)

    def calibrated(self) -> SelfModel:
        """Return the robot that knows its arm and cameras without error, and no mirror."""
        q = np.random.default_rng(0).uniform(*self._limits, (200, len(self.joints)))
        # Play that is uniform within +-p has the standard deviation p / sqrt 3.
        lever = _levers(self.__mechanics.chain, q)
        return self.ground_truth.model(
            f"calibrated body {self._seed}",
            noise_sigma=lever * self.play / np.sqrt(3.0),
            pixel_sigma=self.pixel_sigma,
        )

    def _see(self, mirror: str, encoders: NDArray, rng: np.random.Generator) -> NDArray:
        """Return noisy pixels of poses, nan where a camera does not see the hand. Shape (N, 4)."""
        q = self.__mechanics.servos.to_joint(encoders)
        p = self.__mechanics.chain.forward(q + rng.uniform(-1.0, 1.0, q.shape) * self.play)
        pixels = self._reflect(self.__mirrors[mirror], p) if mirror else self.__rig.project(p)
        noisy = pixels + rng.normal(0.0, self.pixel_sigma, pixels.shape)
        inside = inside_images(noisy, self.__rig.left.image_size, _EDGE)
        return np.where(inside.all(axis=1, keepdims=True), noisy, np.nan)

    def _reflect(self, mirror: Mirror, p: NDArray) -> NDArray:
        """Return exact pixels of reflections of what keeps clear of the glass. Shape (N, 4)."""
        if self._radius is None:
            pixels = MirrorRig(self.__rig, mirror).project(p)
        else:
            cameras = self.__rig.cameras
            pixels = np.concatenate(
                [curved_reflection(c, mirror, self._radius, p, c.X_WC) for c in cameras], axis=1
            )
        clear = np.asarray(mirror.in_front_by(p)) > _CLEARANCE
        return np.where(clear[:, None], pixels, np.nan)

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
            marker=np.full(len(encoders), self.__mechanics.chain.markers[0]),
            pixel_sigma_px=self.pixel_sigma,
            image_size=self.__rig.left.image_size,
            source=f"simulated, robot {self._seed}, mirror {kind}",
            seed=self._seed,
        )


def _levers(chain: Chain, q: NDArray) -> float:
    """Return what one radian of play in every joint does to a coordinate of the hand, rms [m]."""
    step = 1e-6
    moved = [chain.forward(q + step * axis) - chain.forward(q) for axis in np.eye(q.shape[1])]
    return float(np.sqrt(np.sum(np.square(moved)) / (3.0 * len(q)))) / step
