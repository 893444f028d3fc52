"""The scene that a result folder keeps beside its report."""

from pathlib import Path

from nico_selfmodel.errors import DataError, ModelError
from nico_selfmodel.files.reading import LARGEST_SCENE, read_text
from nico_selfmodel.viz.scene import Scene

SCENE_FILE = "scene.json"


def load_scene(result: str | Path) -> Scene:
    """Read the scene of a result folder, so that it can be drawn without learning again.

    Args:
        result: The folder, or its `scene.json`.

    Returns:
        The scene.

    Raises:
        ModelError: If there is none, or it is not valid.
    """
    path = Path(result)
    path = path / SCENE_FILE if path.is_dir() else path
    if not path.exists():
        raise ModelError(
            f"{path} does not exist: give the folder that `calibrate` or `learn` wrote"
        )
    try:
        text = read_text(path, LARGEST_SCENE)
    except DataError as error:
        reason = str(error).removeprefix(f"{path}: ").removeprefix("cannot be read: ")
        raise ModelError(f"{path} cannot be read: {reason}") from error
    try:
        return Scene.from_json(text)
    except ModelError as error:
        raise ModelError(f"{path}: {error}") from error
