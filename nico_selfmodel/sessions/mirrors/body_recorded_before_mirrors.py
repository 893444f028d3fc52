"""A simulated whole Nico that knows itself before mirrors, recorded through rendered pictures."""

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.dataset.body.body_dataset import BodyDataset
from nico_selfmodel.model.cameras.camera import Camera
from nico_selfmodel.model.cameras.mirror import Mirror
from nico_selfmodel.model.cameras.stereo_rig import StereoRig
from nico_selfmodel.planning.body_before_mirror import BodyBeforeMirror
from nico_selfmodel.recording.recorded_samples import RecordedSamples
from nico_selfmodel.recording.session import Progress, sample_pose
from nico_selfmodel.sessions.rendered_body import RenderedBody
from nico_selfmodel.sessions.whole_recording import WholeRecording
from nico_selfmodel.systems.rendering.mirror_scene import MirrorPlate, put_mirror
from nico_selfmodel.systems.rendering.stereo_cameras import ImageQuality
from nico_selfmodel.systems.simulated.imperfections import Imperfections
from nico_selfmodel.systems.stations.station_body import StationBody

FINE = ImageQuality()
"""Reflections are small: coarse pictures do not show what is printed on a hand."""
_POOL = 30
"""Poses of each hand, of which those are taken that tell most of where a glass stands."""


def body_recorded_before_mirrors(
    world: Imperfections | str,
    seed: int,
    session: int,
    whole: WholeRecording,
    mirrors: Mapping[str, Mirror],
    poses: int,
    name: str,
    *,
    lenses: Mapping[str, Camera],
    progress: Progress | None = None,
) -> BodyDataset:
    """Let a whole Nico look at its hands in mirrors, one after the other, and at the room beside.

    Args:
        seed: Which robot.
        session: Which day.
        whole: What moves, and what hangs about it.
        mirrors: Where each stands before the left camera of the robot as described that looks
            straight ahead.
        poses: Poses before each, the hands by turns.
        lenses: Calibrated cameras by name, behind whose lenses markers are located.

    Returns:
        What its cameras saw of hands' cards in the glass, and of everything directly.

    Raises:
        ModelError: If hardly any pose shows a hand in one of the mirrors.
        DataError: If nothing was seen.
        ValueError: If no arm moves, or no pose is wanted.
    """
    if not whole.arms or poses < 1:
        raise ValueError("nothing to see in a mirror: an arm must move, to one pose or more")
    plate, rng = MirrorPlate(), np.random.default_rng((seed, session, 29))
    hands, size = list(whole.hands.values()), (plate.width, plate.height)
    plan: list[tuple[str, NDArray, NDArray]] = []
    for mirror, place in mirrors.items():
        before = BodyBeforeMirror.of(whole.view, place, size, hands, rng)
        turns = before.by_turns(hands, poses, rng, _POOL)
        plan += [(mirror, before.glass.X_WM, q) for _, q in turns]
    robot = RenderedBody(world, seed, whole, FINE)
    with robot.station(session, StereoRig(*lenses.values()), plate) as nico:
        body = StationBody(nico, nico.joints, whole.tracked)
        commands = whole.commands(nico.joints, np.array([q for _, _, q in plan]))
        about = {
            "name": name,
            "source": nico.world.origin("rendered whole nico before mirrors", seed, session),
            "seed": seed,
            "image_size": nico.image_size,
        }
        with RecordedSamples(body.joints, body.markers, about) as kept:
            for index, ((mirror, X_WM, _), command) in enumerate(zip(plan, commands, strict=True)):
                put_mirror(nico, body.context, X_WM)
                sample_pose(body, kept, index, "", command, 1, mirror)
                if progress is not None:
                    progress(index + 1, len(plan))
        data = kept.dataset()
    return whole.dataset(data, lenses)
