"""What cannot be held or freed, because its value would be told from nowhere: one line each."""

from collections.abc import Collection

from nico_selfmodel.dataset.body.body_dataset import BodyDataset
from nico_selfmodel.dataset.body.sensors import PLANE, SIGHTS
from nico_selfmodel.estimation.tree.tree_parameters import FRAME_PARTS, SHIFTS
from nico_selfmodel.model.tree.body_tree import WHOLE_POSES, BodyTree
from nico_selfmodel.names import listed


def refuse_frames(tree: BodyTree, held: Collection[str]) -> None:
    """Refuse to hold parts of joint frames: without a description they are told from nowhere.

    Raises:
        ValueError: If some are; it names them.
    """
    both = zip(tree.joints, tree.motions, strict=True)
    joints = [joint for joint, motion in both if motion not in WHOLE_POSES]
    own = sorted(_parts_of(joints) & set(held))
    if own:
        raise ValueError(
            f"{listed(own)} can only be held against a robot description: without one a joint's "
            "frame is told from wherever it was found; give --robot, or hold a marker or sensor"
        )


def refuse_planes(data: BodyDataset, held: Collection[str]) -> None:
    """Refuse to hold parts of planes that are told from wherever they were found.

    Raises:
        ValueError: If some are; it names them.
    """
    for sensor in data.sensors:
        own = sorted(_parts_of([sensor.name]) & set(held))
        if sensor.kind == PLANE and sensor.X_LS is None and own:
            raise ValueError(
                f"{listed(own)} can only be held against a told place of plane {sensor.name!r}: "
                "give it a 'pose' in dataset.yaml, z its normal, from which its parts are told"
            )


def refuse_untold(data: BodyDataset, held: Collection[str]) -> None:
    """Refuse to hold markers and sensors where a guess has them: a value must be told.

    Args:
        data: The recording.
        held: What is held where the search begins, that would move else.

    Raises:
        ValueError: If some are; it names them.
    """
    guessed = [marker.name for marker in data.markers]
    guessed += [s.name for s in data.sensors if s.kind in SIGHTS and s.X_LS is None]
    own = sorted(_parts_of(guessed) & set(held))
    if own:
        raise ValueError(
            f"nothing tells {listed(own)}: held where a guess has it, all else would bend to that; "
            f"give its value (--fix {own[0]}=VALUE), or leave out --fix {own[0]}"
        )


def refuse_free_world(world: str, freed: Collection[str]) -> None:
    """Refuse to free the place of what stands for the world where nothing tells lengths.

    Raises:
        ValueError: If some part is freed; it names it.
    """
    own = sorted({f"{world}.{part}" for part in SHIFTS} & set(freed))
    if own:
        raise ValueError(
            f"{listed(own)}: {world!r} stands for the world, and nothing tells lengths; free, it "
            f"lets the body grow without end: leave out --free {own[0]}, or tell a length"
        )


def _parts_of(names: Collection[str]) -> set[str]:
    return {f"{name}.{part}" for name in names for part in FRAME_PARTS}
