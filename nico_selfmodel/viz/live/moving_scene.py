"""A scene in Meshcat whose parts move: live, or frame by frame onto a page."""

from dataclasses import replace

from numpy.typing import NDArray
from pydrake.math import RigidTransform

from nico_selfmodel.viz.live.drake_backend import draw_in_drake, draw_item
from nico_selfmodel.viz.live.live_page import recorded
from nico_selfmodel.viz.scene.scene import ROOT, Scene
from nico_selfmodel.viz.scene.scene_items import Item

_SECONDS_A_FRAME = 1.0 / 8.0


class MovingScene:
    """What was drawn once, and is moved, hidden and drawn anew afterwards."""

    def __init__(self, scene: Scene, *, recording: bool) -> None:
        """Draw everything once.

        Args:
            recording: Keep every frame of an animation, for `html`.

        Raises:
            SelfModelError: If the server cannot start.
        """
        self._shown: dict[str, str] = {}
        self._recording, self._frames = recording, 0
        self.meshcat = draw_in_drake(scene)
        if recording:
            self.meshcat.StartRecording(
                frames_per_second=1.0 / _SECONDS_A_FRAME, set_visualizations_while_recording=True
            )

    @property
    def _time(self) -> float | None:
        """When the present frame is shown in the recording [s]; None where nothing is kept."""
        return self._frames * _SECONDS_A_FRAME if self._recording else None

    def html(self) -> str:
        """Return what was shown as one page, with its animation if it was recorded."""
        if self._recording:
            self.meshcat.StopRecording()
            self.meshcat.PublishRecording()
        return recorded(self.meshcat.StaticHtml())

    def _show_item(self, name: str, item: Item | None, time: float | None) -> None:
        """Draw what is new at every moment, None for nothing.

        A recording holds motions, not shapes: it keeps all of them, one visible at a time.
        """
        before = self._shown.pop(name, None)
        folder = name.rpartition("/")[0]
        stem = folder if name.endswith("/image") else name
        path = name if time is None else f"{stem}/frame_{self._frames}"
        if before is not None and (time is not None or item is None):
            self._set_visible(before, False, time)
        if item is None:
            return
        self._shown[name] = path
        draw_item(self.meshcat, f"{ROOT}/{path}", replace(item, path=path))
        self._place(path, item.X_WI, None)
        if time is not None and self._frames:
            self._set_visible(path, False, 0.0)
        self._set_visible(path, True, time)

    def _place(self, path: str, X: NDArray, time: float | None) -> None:
        self.meshcat.SetTransform(f"{ROOT}/{path}", RigidTransform(pose=X), time_in_recording=time)

    def _set_visible(self, path: str, visible: bool, time: float | None) -> None:
        self.meshcat.SetProperty(f"{ROOT}/{path}", "visible", visible, time_in_recording=time)
