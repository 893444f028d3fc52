"""A Nico that knows cameras and arm meets a mirror, and learns where it stands (chapter 9)."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.dataset.dataset import Dataset
from nico_selfmodel.estimation.judging import judge, to_json
from nico_selfmodel.estimation.mirrors.mirror import MirrorCalibration, calibrate_mirrors
from nico_selfmodel.estimation.mirrors.mirror_findings import judged
from nico_selfmodel.estimation.results.verdict import Verdict
from nico_selfmodel.model.cameras.mirror import Mirror
from nico_selfmodel.model.self_model import SelfModel
from nico_selfmodel.planning.mirror_view import ENOUGH
from nico_selfmodel.plant import ArmDescription
from nico_selfmodel.sessions.body_scenario import BodyScenario
from nico_selfmodel.sessions.camera_scenario import RenderedNico
from nico_selfmodel.sessions.mirrors.nico_before_mirrors import DEFAULT_MIRROR, NicoBeforeMirrors
from nico_selfmodel.sessions.progress import Stage, telling
from nico_selfmodel.systems.rendering.mirror_scene import MirrorPlate
from nico_selfmodel.systems.simulated.imperfections import Imperfections
from nico_selfmodel.viz.scene.mirror_picture import MirrorPicture

MIRROR = "mirror"
"""What the mirror is called in the self-model."""
DAY = 4
POSES = 20


@dataclass(frozen=True, eq=False)
class MirrorScenario:
    """A mirror learned by looking into it."""

    calibration: MirrorCalibration
    """Of the mirror; its model knows it."""
    verdict: Verdict
    """What is thought of that."""
    train: Dataset
    """The hand in the mirror, to learn from."""
    test: Dataset
    """The same, held out."""
    picture: MirrorPicture
    """What the robot saw of itself at one of the poses."""

    @property
    def model(self) -> SelfModel:
        """Arm, cameras and mirror."""
        return self.calibration.model

    @property
    def document(self) -> dict[str, Any]:
        """What `result.json` tells of the mirror."""
        return to_json(self.calibration, self.verdict)


def learn_mirror(
    model: SelfModel,
    world: Imperfections | str,
    seed: int = 0,
    *,
    marker: str = "fiducial",
    familiar: NDArray | None = None,
    poses: int = POSES,
    held_out: int | None = None,
    plate: MirrorPlate | None = None,
    mirrors: Mapping[str, Mirror] | None = None,
    arm: ArmDescription | None = None,
    choices: int = ENOUGH,
    day: int = DAY,
    stage: Stage | None = None,
) -> MirrorScenario:
    """Put mirrors before the robot, let it look at its hand in each, and learn where they stand.

    Args:
        model: What the robot has learned of arm and cameras.
        seed: Which robot.
        marker: What is tracked on the hand.
        familiar: Readings at which the arm was learned: poses near them are preferred. (K, n).
        poses: To learn from, in each mirror.
        held_out: More poses in each, to judge by; as many as to learn from if omitted.
        mirrors: Name -> where that mirror is meant to stand; `MIRROR` at the default place if
            omitted.
        arm: Its arm, if that is another one than `looking_arm`.
        choices: Poses of the hand in each mirror from which to choose.
        day: On which it looks: poses and noise of another are others.

    Raises:
        EstimationError: If no plane fits.
    """
    nico = RenderedNico(world, seed, (marker,), arm=arm)
    places = mirrors or {MIRROR: DEFAULT_MIRROR}
    wanted = poses + (poses if held_out is None else held_out)
    shown = next(iter(places))
    before = NicoBeforeMirrors(
        nico, places, plate=plate, knows=model, rig=model.rig, familiar=familiar, choices=choices
    )
    data = before.record(
        "mirror", day, wanted, progress=telling(stage, "looking at its hand in a mirror")
    )
    aside = held_out_rows(data, 1.0 - poses / wanted)
    train, test = data.select(~aside), data.select(aside)
    telling(stage, "learning the mirror")(0, 1)
    calibration = calibrate_mirrors(train, model, test=test)
    telling(stage, "learning the mirror")(1, 1)
    row = int(np.flatnonzero((train.mirror == shown) & np.isfinite(train.pixels).all(axis=1))[0])
    images = before.look(day, shown, train.encoders[row])
    picture = MirrorPicture(int(train.sample[row]), train.encoders[row], images)
    verdict = judge(calibration)
    return MirrorScenario(judged(calibration, verdict), verdict, train, test, picture)


def held_out_rows(data: Dataset, share: float) -> NDArray:
    """Choose a share of the poses, evenly, so that chosen and others cover the same places.

    Returns:
        Which rows belong to them. Boolean, shape (N,).
    """
    samples = np.unique(data.sample)
    count = round(share * len(samples))
    last = np.floor((1.0 + np.arange(count)) * len(samples) / max(count, 1)).astype(int) - 1
    return np.isin(data.sample, samples[last])


def with_mirror(scenario: BodyScenario, mirror: MirrorScenario) -> BodyScenario:
    """Return what was learned of a body, its self-model now with the mirror.

    Args:
        scenario: Cameras and arm.
        mirror: Learned with the model of that scenario.
    """
    if scenario.refined is not None and scenario.accepted:
        return replace(scenario, refined=replace(scenario.refined, model=mirror.model))
    calibration = replace(scenario.arm.calibration, model=mirror.model)
    return replace(scenario, arm=replace(scenario.arm, calibration=calibration))
