"""Chapter 9 of the thesis: the hand predicted in three mirrors after 10 to 50 poses of training."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.dataset.dataset import Dataset
from nico_selfmodel.estimation.mirrors.mirror import calibrate_mirrors
from nico_selfmodel.estimation.mirrors.mirror_cameras import fit_mirror_cameras
from nico_selfmodel.experiments.mirror_body import MIRRORS, learned_body, mirror_body
from nico_selfmodel.model.cameras.mirror import Mirror
from nico_selfmodel.model.cameras.stereo_rig import StereoRig
from nico_selfmodel.model.self_model import SelfModel
from nico_selfmodel.plant import ArmDescription
from nico_selfmodel.sessions.progress import Stage
from nico_selfmodel.systems.simulated.mirrors import SimulatedMirrors

POSES = (10, 20, 30, 40, 50)
TEST_POSES = 100
Spread = tuple[float, float | None]
"""Mean and SD over robots; None where there was only one."""
COMPARABLE_MM = 50.0
"""What Hersch et al. and Martinez-Cantin et al. report without a mirror (thesis, section 9.2.2)."""


@dataclass(frozen=True)
class MirrorRow:
    """One mirror after some poses, averaged over robots; pairs are mean and SD over them."""

    mirror: str
    """Which of the mirrors."""
    poses: int
    """Poses learned from."""
    pixels: Spread
    """Error of the predicted reflection on test poses [px]."""
    position_mm: Spread
    """Distance of the hand rebuilt through the mirror from where the arm says."""
    arm_share: float
    """The same as a share of the arm's length."""
    angle_deg: float | None
    """Error of the mirror's normal; None where nobody knows how it really stands."""
    distance_mm: float | None
    """Error of the mirror's distance, or None."""
    cameras_px: float
    """Error of the thesis' two independent mirror cameras, learned from the same poses [px]."""
    seconds: float
    """Time of an estimation with all its checks."""


@dataclass(frozen=True)
class DepthRow:
    """How far away the hand seems, and what two cameras can tell at that distance."""

    view: str
    """`direct`, or the mirror."""
    depth_mm: float
    """Distance of the hand, or of its reflection, from the left camera."""
    stereo_mm: float
    """Mean error of stereo with this noise there, were arm and mirror known exactly."""
    pixels: Spread
    """Error on test poses [px]: mean and SD over robots."""
    position_mm: Spread
    """The same in space."""


@dataclass(frozen=True)
class MirrorExperiment:
    """All conditions."""

    individuals: int
    """Simulated robots averaged over."""
    pixel_sigma: float
    """Noise of a tracked pixel coordinate [px]."""
    play_deg: float
    """Half the width of the joints' noise [deg]."""
    rendered: bool
    """Whether the hand was found in rendered pictures; otherwise its pixels were calculated."""
    places_mm: Mapping[str, float]
    """Mirror -> distance from the left camera at which it was meant to stand."""
    arm_mm: float
    """Length of the arm, as described."""
    rows: tuple[MirrorRow, ...]
    """Every mirror after every number of poses."""
    depth: tuple[DepthRow, ...]
    """The direct view, then the mirrors after all poses."""


def run_mirror(
    individuals: int = 5,
    pixel_sigma: float = 0.3,
    play_deg: float = 0.5,
    seed: int = 0,
    progress: Stage | None = None,
) -> MirrorExperiment:
    """Let simulated robots learn arm and cameras, then three mirrors.

    Args:
        individuals: Simulated robots.
        pixel_sigma: Noise of a tracked pixel coordinate [px].
        play_deg: Half the width of the joints' noise [deg].
        seed: Of the first robot.
    """
    found = []
    for i in range(individuals):
        body = mirror_body(seed + i, pixel_sigma=pixel_sigma, play_deg=play_deg)
        found.append(_simulated(body))
        if progress:
            progress("learning mirrors", i + 1, individuals)
    return experiment_of(found, pixel_sigma, play_deg, MIRRORS)


def experiment_of(
    trials: Sequence["Trial"],
    pixel_sigma: float,
    play_deg: float,
    mirrors: Mapping[str, Mirror],
    rendered: bool = False,
) -> MirrorExperiment:
    """Average over robots.

    Args:
        trials: What each of them learned.
        pixel_sigma: Noise of a tracked pixel coordinate [px].
        play_deg: Half the width of the joints' noise [deg].
        mirrors: Where they were meant to stand.
        rendered: Whether the hand was found in rendered pictures.
    """
    arm = arm_length()
    rows = [
        _row(name, count, [trial.learned[name, count] for trial in trials], arm)
        for name in mirrors
        for count in POSES
    ]
    views = ["direct", *mirrors]
    depth = [_depth_row(view, [trial.views[view] for trial in trials]) for view in views]
    places = {name: 1e3 * mirror.distance for name, mirror in mirrors.items()}
    return MirrorExperiment(
        len(trials),
        pixel_sigma,
        play_deg,
        rendered,
        places,
        1e3 * arm,
        tuple(rows),
        tuple(depth),
    )


def arm_length() -> float:
    """Return the length of Nico's arm as described, shoulder to elbow to marker [m]."""
    chain = ArmDescription.named("nico").chain
    shoulder, elbow, hand = chain.points[0], chain.points[-1], chain.p_WH_zero[0]
    return float(np.linalg.norm(elbow - shoulder) + np.linalg.norm(hand - elbow))


@dataclass(frozen=True, eq=False)
class Trial:
    """One robot: (mirror, poses) -> figures, and view -> figures."""

    learned: dict[tuple[str, int], tuple[float, ...]]
    """px, mm, error of the normal [deg] and of the distance [mm], px of free cameras, seconds."""
    views: dict[str, tuple[float, ...]]
    """Distance [mm], what stereo alone allows there [mm], px, mm."""

    @classmethod
    def of(
        cls,
        model: SelfModel,
        direct: Dataset,
        training: Mapping[str, Dataset],
        test: Mapping[str, Dataset],
        pixel_sigma: float,
        true: Mapping[str, Mirror] | None = None,
    ) -> "Trial":
        """Learn every mirror from some of the poses, and judge it.

        Args:
            model: What the body knows of arm and cameras.
            direct: Test poses without a mirror.
            training: Mirror -> poses, as many as `POSES` asks for.
            test: Mirror -> test poses.
            pixel_sigma: Noise of a tracked pixel coordinate, for what stereo alone allows [px].
            true: Where the mirrors really stand, if anybody knows.
        """
        learned, views = {}, {"direct": _direct(direct, model, pixel_sigma)}
        for name, data in training.items():
            stands = None if true is None else true[name]
            for count in POSES:
                some = data.select(np.arange(count))
                learned[name, count], views[name] = _learn(
                    model, name, some, test[name], stands, pixel_sigma
                )
        return cls(learned, views)


def _simulated(body: SimulatedMirrors) -> Trial:
    """Let a body whose pixels are calculated learn."""
    return Trial.of(
        learned_body(body),
        body.watch("", TEST_POSES, session=3),
        {name: body.watch(name, max(POSES), session=2) for name in MIRRORS},
        {name: body.watch(name, TEST_POSES, session=3) for name in MIRRORS},
        body.pixel_sigma,
        body.ground_truth.mirrors,
    )


def _learn(
    model: SelfModel,
    name: str,
    training: Dataset,
    test: Dataset,
    true: Mirror | None,
    pixel_sigma: float,
) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """Return the figures of a row and of a view."""
    found = calibrate_mirrors(training, model, test=test)
    assert found.test is not None
    mirror = found.mirrors[name]
    cameras = fit_mirror_cameras(found.solution.reflections).evaluate(found.test.reflections)
    pixels, position = found.test.distances_px.mean(), found.test.distances.mean()
    row = (
        float(pixels),
        1e3 * float(position),
        np.nan if true is None else float(np.degrees(mirror.angle_to(true))),
        np.nan if true is None else 1e3 * abs(mirror.distance - true.distance),
        float(cameras.distances_px.mean()),
        found.seconds,
    )
    seen = mirror.reflect(found.test.reflections.p_LQ)
    depth, stereo = _stereo(model.rig, test.pixels, seen, pixel_sigma)
    return row, (depth, stereo, float(pixels), 1e3 * float(position))


def _direct(test: Dataset, model: SelfModel, pixel_sigma: float) -> tuple[float, ...]:
    """Return the figures of the hand seen directly."""
    p, rig = model.predict(test.encoders).p_WH, model.rig
    miss = np.linalg.norm((rig.project(p) - test.pixels).reshape(len(p), 2, 2), axis=2)
    usable = _with_rays(rig, test.pixels)
    rebuilt = rig.triangulate(test.pixels[usable], pixel_sigma).p_WQ
    error = float(np.mean(np.linalg.norm(rebuilt - p[usable], axis=1)))
    depth, stereo = _stereo(rig, test.pixels, p, pixel_sigma)
    return depth, stereo, float(np.nanmean(miss)), 1e3 * error


def _stereo(rig: StereoRig, pixels: NDArray, p: NDArray, sigma: float) -> tuple[float, float]:
    """Return mean distance of points and the mean error that pixel noise alone makes there [mm]."""
    covariance = rig.triangulate(pixels[_with_rays(rig, pixels)], sigma).covariance
    rng = np.random.default_rng(0)
    draws = np.linalg.cholesky(covariance) @ rng.normal(size=(len(covariance), 3, 50))
    distance = np.linalg.norm(p - rig.left.X_WC[:3, 3], axis=1)
    return 1e3 * float(distance.mean()), 1e3 * float(np.linalg.norm(draws, axis=1).mean())


def _with_rays(rig: StereoRig, pixels: NDArray) -> NDArray:
    usable = rig.left.has_rays(pixels[:, :2]) & rig.right.has_rays(pixels[:, 2:])
    return np.asarray(usable)


def _row(name: str, count: int, figures: list[tuple[float, ...]], arm: float) -> MirrorRow:
    pixels, position, angle, distance, cameras, seconds = np.array(figures).T
    return MirrorRow(
        name,
        count,
        _mean_and_sd(pixels),
        _mean_and_sd(position),
        float(position.mean()) / (1e3 * arm),
        None if np.isnan(angle).any() else float(angle.mean()),
        None if np.isnan(distance).any() else float(distance.mean()),
        float(cameras.mean()),
        float(seconds.mean()),
    )


def _depth_row(view: str, figures: list[tuple[float, ...]]) -> DepthRow:
    depth, stereo, pixels, position = np.array(figures).T
    return DepthRow(
        view, float(depth.mean()), float(stereo.mean()), _mean_and_sd(pixels),
        _mean_and_sd(position),
    )  # fmt: skip


def _mean_and_sd(values: NDArray) -> Spread:
    return float(values.mean()), float(values.std()) if len(values) > 1 else None
