"""A simulated body that sees its own hand, and keeps its geometry and its lenses to itself.

Nothing is rendered: the hand's true place is projected into both eyes, with the tracker's noise.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from types import MappingProxyType

import numpy as np
from numpy.typing import ArrayLike, NDArray

from nico_selfmodel.dataset import BoardViews, JointInfo
from nico_selfmodel.geometry.rotation import rotation_from_vector
from nico_selfmodel.geometry.transform import apply, inverse, transform
from nico_selfmodel.model import Chain, ServoMap, StereoRig
from nico_selfmodel.model.link_lengths import link_lengths
from nico_selfmodel.systems.simulated_arm import (
    _individual,
    _largest_torque,
    _servos,
    _stops,
    disturbed_angles,
)
from nico_selfmodel.systems.simulated_eyes import NICO_CAMERAS, SimulatedEyes, _individual_rig
from nico_selfmodel.systems.worlds import Imperfections

TRACKERS: Mapping[str, float] = MappingProxyType({"fiducial": 0.3, "color": 2.0})
"""Noise of a tracked pixel coordinate, independent in both eyes [px]."""
_EDGE = 4.0
"""A marker this near to the image's edge is not found [px]."""
_NECK_TURN, _NECK_SHIFT = np.radians(2.0), 3e-3
"""How far the head stands from where the description has it [rad, m]."""


@dataclass(frozen=True, eq=False)
class HandSighting:
    """What the body senses of its hand at one pose."""

    encoders: NDArray
    """Encoder readings [counts]. Shape (n,)."""
    pixels: Mapping[str, NDArray]
    """Pixels of each marker in both eyes, nan where an eye does not see it. Shape (4,)."""


class SimulatedBody:
    """Encoders that can be commanded and eyes that find markers; nothing else shows to a learner.

    `observe`, `expected` and `calipers` are what an outsider would say, for judging only.
    """

    def __init__(
        self,
        nominal: Chain,
        lower: ArrayLike,
        upper: ArrayLike,
        X_BL: ArrayLike,
        world: Imperfections,
        seed: int,
        session: int = 0,
        *,
        pixel_sigma: float = TRACKERS["fiducial"],
        eyes: StereoRig = NICO_CAMERAS,
    ) -> None:
        """Build one individual of a robot.

        Args:
            nominal: The arm as described, in the base's frame (z up) and zero.
            lower: Lower joint stops [rad]. Shape (n,).
            upper: Upper joint stops [rad]. Shape (n,).
            X_BL: Pose of the left eye in the base as described. Shape (4, 4).
            world: What is wrong with the body; its marker noise and drop-outs do not count here.
            seed: Of the individual: geometry, gears, encoder zeros, lenses.
            session: Of the random things that happen to it: play and pixel noise.
            pixel_sigma: Noise of a tracked pixel coordinate [px].
            eyes: The eyes as designed, the left one at the world.

        Raises:
            ValueError: If a stop is missing or crossed, or a joint has no room to move.
        """
        lower, upper = np.asarray(lower, dtype=float), np.asarray(upper, dtype=float)
        if not (np.isfinite(lower) & np.isfinite(upper) & (lower < upper)).all():
            raise ValueError("a simulated body needs finite lower < upper limits of every joint")
        build = np.random.default_rng((seed, 9))
        self.world, self.pixel_sigma = replace(world), float(pixel_sigma)
        self._rng = np.random.default_rng((seed, session, 10))
        self.__true_chain = _individual(nominal, world, build)
        self.__servos = _servos(nominal.joints, world, build)
        self._stops = _stops(self.__servos, lower, upper, world, np.random.default_rng((seed, 2)))
        self.__largest_torque = 1.0
        if world.sag:
            sampled = np.random.default_rng((seed, 15))
            self.__largest_torque = _largest_torque(self.__true_chain, lower, upper, sampled)
        turn = rotation_from_vector(build.normal(0.0, _NECK_TURN, 3))
        shift = build.normal(0.0, _NECK_SHIFT, 3)
        self.__rig = _individual_rig(seed, eyes)
        # The rig stands only nearly at its own world: what counts is the true left eye.
        X_BE = np.asarray(X_BL, dtype=float) @ transform(turn, shift)
        self.__X_BL = X_BE @ self.__rig.left.X_WC
        self.__rig = self.__rig.moved(self.__rig.left.X_WC)
        self.__eyes = SimulatedEyes(seed, nominal=eyes)

    @property
    def joints(self) -> tuple[JointInfo, ...]:
        """Names, units and stops of the joints, as a data set states them."""
        turn = self.world.counts_per_turn
        return tuple(
            JointInfo(name, "counts", counts_per_turn=turn, lower=float(low), upper=float(high))
            for name, low, high in zip(self.__servos.joints, *self._stops, strict=True)
        )

    @property
    def markers(self) -> tuple[str, ...]:
        """Names of the markers that the eyes can find."""
        return self.__true_chain.markers

    @property
    def image_size(self) -> tuple[int, int]:
        """Width and height of the images [px]."""
        return self.__rig.left.image_size

    def move_and_measure(self, command: ArrayLike) -> HandSighting:
        """Move to encoder readings, settle, and look.

        Args:
            command: Where to go [counts]; kept between the stops. Shape (n,).

        Returns:
            What was sensed there.

        Raises:
            ValueError: If the command has another length or is not finite.
        """
        return self.observe(command)[0]

    def observe(self, command: ArrayLike) -> tuple[HandSighting, NDArray]:
        """Visit a pose while an outsider measures the markers exactly, in the left eye's frame.

        Args:
            command: As for `move_and_measure`.

        Returns:
            What the body senses, and where the markers are [m], shape (m, 3).

        Raises:
            ValueError: As `move_and_measure`.
        """
        command = np.asarray(command, dtype=float)
        if command.shape != (len(self.__servos.joints),) or not np.isfinite(command).all():
            raise ValueError(f"command must be {len(self.__servos.joints)} finite counts")
        encoders = np.clip(np.round(command), *self._stops)
        q = disturbed_angles(
            self.__true_chain,
            self.__servos.to_joint(encoders),
            self.world,
            self.__largest_torque,
            self._rng,
        )
        rows = np.tile(q, (len(self.markers), 1))
        p_BH = self.__true_chain.forward(rows, np.arange(len(self.markers)))
        p_LH = apply(inverse(self.__X_BL), p_BH)
        pixels = self._found(self.__rig.project(p_LH))
        named = dict(zip(self.markers, pixels, strict=True))
        return HandSighting(encoders, MappingProxyType(named)), p_LH

    def expected(self, encoders: ArrayLike) -> tuple[NDArray, NDArray]:
        """Say what a body that knew itself exactly would expect: all but what is left to chance.

        Args:
            encoders: Readings [counts]. Shape (N, n).

        Returns:
            Pixels of the first marker in both eyes, nan where out of view, shape (N, 4), and its
            place in the left eye's frame [m], shape (N, 3).
        """
        q = expected_angles(
            self.__true_chain, self.__servos, encoders, self.world, self.__largest_torque
        )
        p_LH = apply(inverse(self.__X_BL), self.__true_chain.forward(q))
        return self.__rig.project(p_LH), p_LH

    def look_at_boards(self, p_GQ: NDArray, count: int, session: int = 0) -> BoardViews:
        """Hold a board before the eyes; see `SimulatedEyes.look_at_boards`."""
        return self.__eyes.look_at_boards(p_GQ, count, session)

    def calipers(self) -> tuple[float, float]:
        """Measure the two links from outside: shoulder to elbow, and elbow to the hand [m]."""
        return link_lengths(self.__true_chain)

    def slip(self, joint: str, angle: float) -> None:
        """Let a joint slip against its encoder; its stops are then read elsewhere.

        Args:
            joint: Its name.
            angle: How far, in the joint's own direction [rad].

        Raises:
            ValueError: If there is no such joint.
        """
        i = self._index(joint)
        offset = self.__servos.offset.copy()
        offset[i] -= self.__servos.gear[i] * angle
        stops = [self.__servos.to_joint(end) for end in self._stops]
        self.__servos = replace(self.__servos, offset=offset)
        moved = [np.round(self.__servos.to_encoder(end)) for end in stops]
        self._stops = (moved[0], moved[1])

    def change_gear(self, joint: str, factor: float) -> None:
        """Multiply a gear, about the middle of the joint's range.

        Args:
            joint: Its name.
            factor: New gear over old.

        Raises:
            ValueError: If there is no such joint.
        """
        i = self._index(joint)
        gear, offset = self.__servos.gear.copy(), self.__servos.offset.copy()
        middle = self.__servos.to_joint(np.mean(self._stops, axis=0))[i]
        offset[i] += gear[i] * middle * (1.0 - factor)
        gear[i] *= factor
        self.__servos = replace(self.__servos, gear=gear, offset=offset)

    def restart(self, seed: int, spread: float = np.radians(10.0)) -> None:
        """Switch off and on again: every encoder has another zero, the joints stay.

        Args:
            seed: Of the zeros.
            spread: Their standard deviation about the old ones [rad].
        """
        change = np.random.default_rng((seed, 11)).normal(0.0, spread, len(self.joints))
        for joint, angle in zip(self.__servos.joints, change, strict=True):
            self.slip(joint, float(angle))

    def take_tool(self, shift: ArrayLike) -> None:
        """Take a tool, on whose tip the markers are from now on.

        Args:
            shift: From the hand's marker to the tip, along the base's axes at q = 0 [m].
                Shape (3,).
        """
        tips = self.__true_chain.p_WH_zero + np.asarray(shift, dtype=float)
        self.__true_chain = replace(self.__true_chain, p_WH_zero=tips)

    def bump_eye(self, turn: ArrayLike) -> None:
        """Turn the right eye by a rotation vector in its own frame [rad]. Shape (3,)."""
        right = self.__rig.right
        turned = right.X_WC @ transform(rotation_from_vector(turn), np.zeros(3))
        self.__rig = replace(self.__rig, right=right.at(turned))

    def _index(self, joint: str) -> int:
        if joint not in self.__servos.joints:
            raise ValueError(f"no joint {joint!r}; there are {', '.join(self.__servos.joints)}")
        return self.__servos.joints.index(joint)

    def _found(self, pixels: NDArray) -> NDArray:
        """Return noisy pixels, nan where a marker lies outside an image. Shape (m, 4)."""
        noisy = pixels + self._rng.normal(0.0, self.pixel_sigma, pixels.shape)
        limit = np.array([*self.image_size, *self.image_size]) - 1.0 - _EDGE
        with np.errstate(invalid="ignore"):
            inside = ((noisy > _EDGE) & (noisy < limit)).reshape(-1, 2, 2).all(axis=2)
        return np.where(np.repeat(inside, 2, axis=1), noisy, np.nan)


def expected_angles(
    chain: Chain, servos: ServoMap, encoders: ArrayLike, world: Imperfections, largest_torque: float
) -> NDArray:
    """Return where joints stand in the mean over what is left to chance: sag, but no play.

    Args:
        chain: The arm as it is built, z up.
        servos: Its gears and encoder zeros.
        encoders: Readings [encoder units]. Shape (N, n).
        world: What is wrong with the body.
        largest_torque: As for `disturbed_angles`.

    Returns:
        Joint angles [rad]. Shape (N, n).
    """
    certain, unused = replace(world, play=0.0, wobble_share=0.0), np.random.default_rng(0)
    q = servos.to_joint(np.atleast_2d(encoders))
    return np.array([disturbed_angles(chain, row, certain, largest_torque, unused) for row in q])
