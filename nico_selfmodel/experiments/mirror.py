"""Chapter 9 of the thesis: the hand predicted in three mirrors after 10 to 50 poses of training."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.dataset import Dataset
from nico_selfmodel.estimation.mirror import calibrate_mirrors
from nico_selfmodel.estimation.mirror_cameras import fit_mirror_cameras
from nico_selfmodel.experiments.mirror_body import MIRRORS, learned_body, mirror_body
from nico_selfmodel.model import SelfModel, StereoRig
from nico_selfmodel.plant import ArmDescription
from nico_selfmodel.systems.simulated_mirror import SimulatedMirrors

POSES = (10, 20, 30, 40, 50)
TEST_POSES = 100
COMPARABLE_MM = 50.0
"""What Hersch et al. and Martinez-Cantin et al. report without a mirror (thesis, section 9.2.2)."""


@dataclass(frozen=True)
class MirrorRow:
    """One mirror after some poses, averaged over individuals; pairs are mean and SD over them."""

    mirror: str
    """Which of the mirrors."""
    poses: int
    """Poses learned from."""
    pixels: tuple[float, float]
    """Error of the predicted reflection on test poses [px]."""
    position_mm: tuple[float, float]
    """Distance of the hand rebuilt through the mirror from where the arm says."""
    arm_share: float
    """The same as a share of the arm's length."""
    angle_deg: float
    """Error of the mirror's normal."""
    distance_mm: float
    """Error of the mirror's distance."""
    cameras_px: float
    """Error of the thesis' two independent mirror cameras, learned from the same poses [px]."""
    seconds: float
    """Time of an estimation with all its checks."""


@dataclass(frozen=True)
class DepthRow:
    """How far away the hand seems, and what two eyes can tell at that distance."""

    view: str
    """`direct`, or the mirror."""
    depth_mm: float
    """Distance of the hand, or of its reflection, from the left eye."""
    stereo_mm: float
    """Mean error of stereo with this noise there, were arm and mirror known exactly."""
    pixels: tuple[float, float]
    """Error on test poses [px]: mean and SD over individuals."""
    position_mm: tuple[float, float]
    """The same in space."""


@dataclass(frozen=True)
class MirrorExperiment:
    """All conditions."""

    individuals: int
    """Simulated robots averaged over."""
    pixel_sigma: float
    """Noise of a tracked pixel coordinate [px]."""
    play_deg: float
    """Half the width of the joints' play [deg]."""
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
    progress: Callable[[str, int, int], None] | None = None,
) -> MirrorExperiment:
    """Let simulated robots learn arm and eyes, then three mirrors.

    Args:
        individuals: Simulated robots.
        pixel_sigma: Noise of a tracked pixel coordinate [px].
        play_deg: Half the width of the joints' play [deg].
        seed: Of the first individual.
        progress: Told how far it is.

    Returns:
        The tables' rows.
    """
    found = []
    for i in range(individuals):
        body = mirror_body(seed + i, pixel_sigma=pixel_sigma, play_deg=play_deg)
        found.append(_Trial.of(body, learned_body(body)))
        if progress:
            progress("learning mirrors", i + 1, individuals)
    arm = arm_length()
    rows = [
        _row(name, count, [trial.learned[name, count] for trial in found], arm)
        for name in MIRRORS
        for count in POSES
    ]
    views = ["direct", *MIRRORS]
    depth = [_depth_row(view, [trial.views[view] for trial in found]) for view in views]
    return MirrorExperiment(
        individuals, pixel_sigma, play_deg, 1e3 * arm, tuple(rows), tuple(depth)
    )


def arm_length() -> float:
    """Return the length of Nico's arm as described, shoulder to elbow to marker [m]."""
    chain = ArmDescription.named("nico").chain
    shoulder, elbow, hand = chain.points[0], chain.points[-1], chain.p_WH_zero[0]
    return float(np.linalg.norm(elbow - shoulder) + np.linalg.norm(hand - elbow))


@dataclass(frozen=True, eq=False)
class _Trial:
    """One individual: (mirror, poses) -> figures, and view -> figures."""

    learned: dict[tuple[str, int], tuple[float, ...]]
    views: dict[str, tuple[float, ...]]

    @classmethod
    def of(cls, body: SimulatedMirrors, model: SelfModel) -> "_Trial":
        direct = body.watch("", TEST_POSES, session=3)
        learned, views = {}, {"direct": _direct(direct, model)}
        for name in MIRRORS:
            training = body.watch(name, max(POSES), session=2)
            test = body.watch(name, TEST_POSES, session=3)
            for count in POSES:
                learned[name, count], views[name] = _learn(
                    body, model, name, training.select(np.arange(count)), test
                )
        return cls(learned, views)


def _learn(
    body: SimulatedMirrors, model: SelfModel, name: str, training: Dataset, test: Dataset
) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """Return the figures of a row and of a view."""
    found = calibrate_mirrors(training, model, test=test)
    assert found.test is not None
    mirror, true = found.mirrors[name], body.true_mirror(name)
    cameras = fit_mirror_cameras(found.solution.reflections).evaluate(found.test.reflections)
    pixels, position = found.test.distances_px.mean(), found.test.distances.mean()
    row = (
        float(pixels),
        1e3 * float(position),
        float(np.degrees(mirror.angle_to(true))),
        1e3 * abs(mirror.distance - true.distance),
        float(cameras.distances_px.mean()),
        found.seconds,
    )
    seen = mirror.reflect(found.test.reflections.p_LQ)
    depth, stereo = _stereo(model.rig, test.pixels, seen, body.pixel_sigma)
    return row, (depth, stereo, float(pixels), 1e3 * float(position))


def _direct(test: Dataset, model: SelfModel) -> tuple[float, ...]:
    """Return the figures of the hand seen directly."""
    p, rig = model.predict(test.encoders).p_WH, model.rig
    miss = np.linalg.norm((rig.project(p) - test.pixels).reshape(len(p), 2, 2), axis=2)
    usable = _with_rays(rig, test.pixels)
    rebuilt = rig.triangulate(test.pixels[usable], test.pixel_sigma_px or 1.0).p_WQ
    error = float(np.mean(np.linalg.norm(rebuilt - p[usable], axis=1)))
    depth, stereo = _stereo(rig, test.pixels, p, test.pixel_sigma_px or 1.0)
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
        float(angle.mean()),
        float(distance.mean()),
        float(cameras.mean()),
        float(seconds.mean()),
    )


def _depth_row(view: str, figures: list[tuple[float, ...]]) -> DepthRow:
    depth, stereo, pixels, position = np.array(figures).T
    return DepthRow(
        view, float(depth.mean()), float(stereo.mean()), _mean_and_sd(pixels),
        _mean_and_sd(position),
    )  # fmt: skip


def _mean_and_sd(values: NDArray) -> tuple[float, float]:
    return float(values.mean()), float(values.std())
