"""A pair of cameras that render what is before them, with lens, noise and motion blur."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pydrake.common.value import AbstractValue
from pydrake.geometry import FrameId, QueryObject
from pydrake.systems.framework import Context, LeafSystem, ValueProducer

from nico_selfmodel.errors import RobotError
from nico_selfmodel.model.cameras.rig_parameters import SIDES
from nico_selfmodel.model.cameras.stereo_rig import StereoRig
from nico_selfmodel.systems.closing import Closable
from nico_selfmodel.systems.image_values import image_value, write_bgr
from nico_selfmodel.systems.rendering.mirror_scene import Glass
from nico_selfmodel.systems.rendering.mounted_camera import Look, MountedCamera, Sight
from nico_selfmodel.vision.images.image_array import sum_of

RENDERER = "cameras"
"""Name under which the scene graph knows the renderer, unless told otherwise."""


@dataclass(frozen=True)
class ImageQuality:
    """What a sensor does to a picture."""

    supersample: int = 2
    """Rendered samples along each side of a pixel."""
    noise: float = 2.0
    """Standard deviation of each colour of each pixel [grey levels of 255]."""
    gain: float = 1.0
    """Brightness; above 1 white is soon over-exposed."""
    fps: float = 30.0
    """Pictures a second: within one frame the noise stays the same [1/s]."""
    exposures: int = 1
    """Renderings over one frame, averaged: 1 is an infinitely short shutter, more is motion
    blur, and then pictures are taken at every frame, asked for or not."""

    def __post_init__(self) -> None:
        """Check the numbers."""
        if self.supersample < 1 or self.exposures < 1:
            raise ValueError(
                "supersample and exposures must be at least 1, got "
                f"{self.supersample} and {self.exposures}"
            )
        if not (self.noise >= 0.0 and self.gain > 0.0 and self.fps > 0.0):
            raise ValueError(
                "noise must not be negative, gain and fps positive, got "
                f"{self.noise}, {self.gain} and {self.fps}"
            )


class StereoCameras(Closable, LeafSystem):
    """Two cameras of a scene graph.

    | port | | carries |
    |---|---|---|
    | `geometry_query` | in | the scene graph's query object |
    | `left_image` | out | picture of the left camera, `ImageRgba8U` |
    | `right_image` | out | picture of the right camera, `ImageRgba8U` |

    Cameras that are told of sights have two ports more, `left_sight` and `right_sight`: the same
    pictures, pixel by pixel, about the sights, and plain everywhere else, which renders faster.
    At one time and pose sights are rendered once, for both ports.

    A picture is rendered when its port is asked for, once for each time and pose. Its noise depends
    on the seed and the number of the frame only, so that the same history gives the same bytes.
    The lenses are those of a `StereoRig` that no port shows.
    """

    def __init__(
        self,
        rig: StereoRig,
        frames: tuple[FrameId, FrameId],
        quality: ImageQuality | None = None,
        *,
        seed: int | tuple[int, ...] = 0,
        renderer: str = RENDERER,
        glasses: Sequence[Glass] = (),
        sights: Sequence[Sight] = (),
        background: Sequence[float] = (0.0, 0.0, 0.0),
        turns: bool = True,
    ) -> None:
        """Mount the cameras.

        Args:
            rig: The cameras; each one's `X_WC` is its pose in its frame.
            frames: What the left and the right camera are mounted on.
            quality: Sampling, noise, exposure.
            renderer: Name of the renderer in the scene graph.
            glasses: Mirrors in the scene graph: `MirrorScene.glasses`.
            sights: What somebody looks at who need not see the rest; not with glasses, nor with
                more than one exposure.
            background: Red, green, blue of the renderer where nothing is, of 1.
            turns: Whether a part of a picture may be rendered turned (`CroppedRender.turns`).

        Raises:
            ModelError: If a lens sees too wide to be rendered.
            ValueError: If there are sights, and glasses or exposures too.
        """
        super().__init__()
        self.quality = quality or ImageQuality()
        if sights and (glasses or self.quality.exposures > 1):
            raise ValueError(
                "sights are for cameras without mirrors and motion blur, got "
                f"{len(sights)} sights, {len(glasses)} mirrors, {self.quality.exposures} exposures"
            )
        self._seed = np.ravel(seed)
        self.__cameras = [
            MountedCamera(
                camera,
                frame,
                self.quality.supersample,
                renderer,
                glasses,
                sights,
                background,
                turns=turns,
            )
            for camera, frame in zip(rig.cameras, frames, strict=True)
        ]
        self._query = self.DeclareAbstractInputPort(
            "geometry_query", AbstractValue.Make(QueryObject())
        )
        needs = {self._query.ticket(), self.time_ticket()}
        if self.quality.exposures > 1:
            self._film = self.DeclareAbstractState(AbstractValue.Make([]))
            period = 1.0 / (self.quality.fps * self.quality.exposures)
            self.DeclarePeriodicUnrestrictedUpdateEvent(period, 0.0, self._expose)
            needs = {self.all_state_ticket(), self.time_ticket()}
        self._looks = [
            self.DeclareCacheEntry(
                f"looks of the {side} camera",
                ValueProducer(
                    lambda: AbstractValue.Make([]),
                    lambda context, value, camera=k: self._find_looks(context, value, camera),
                ),
                needs,
            )
            for k, side in enumerate(SIDES if sights else ())
        ]
        for what in ("image", "sight") if sights else ("image",):
            for side, (name, camera) in enumerate(zip(SIDES, rig.cameras, strict=True)):
                take = self._take if what == "image" else self._look
                self.DeclareAbstractOutputPort(
                    f"{name}_{what}",
                    lambda size=camera.image_size: image_value(*size),
                    lambda context, value, take=take, camera=side: take(context, value, camera),
                    prerequisites_of_calc=needs,
                )

    def _look(self, context: Context, value: AbstractValue, camera: int) -> None:
        """Put what is about the sights on a port."""
        self.require_open()
        light = self.__cameras[camera].only(self._looks_of(context, camera))
        write_bgr(self._develop(light, context.get_time(), camera), value.get_mutable_value())

    def _find_looks(self, context: Context, value: AbstractValue, camera: int) -> None:
        """Keep what a camera sees of the sights, which both of its ports show."""
        query = self._seen(context)
        value.set_value([self.__cameras[camera].look(query)])

    def _looks_of(self, context: Context, camera: int) -> tuple[Look, ...]:
        if not self._looks:
            return ()
        kept: Any = self._looks[camera].Eval(context)
        return kept[0]

    def _take(self, context: Context, value: AbstractValue, camera: int) -> None:
        """Put a picture on a port."""
        if self.quality.exposures > 1:
            film: Any = context.get_abstract_state(self._film).get_value()
            light = (
                np.mean([pair[camera] for pair in film], axis=0)
                if film
                else self._render(context, camera)
            )
        else:
            light = self._render(context, camera)
        write_bgr(self._develop(light, context.get_time(), camera), value.get_mutable_value())

    def _expose(self, context: Context, state: Any) -> None:
        """Add one rendering of both cameras to the film, which holds one frame."""
        film = state.get_mutable_abstract_state(self._film)
        pair = tuple(self._render(context, camera) for camera in range(2))
        film.set_value([*film.get_value(), pair][-self.quality.exposures :])

    def _render(self, context: Context, camera: int) -> NDArray:
        """Return what falls on a sensor, without noise. BGR, shape (h, w, 3)."""
        query = self._seen(context)
        return self.__cameras[camera].render(query, self._looks_of(context, camera))

    def _seen(self, context: Context) -> QueryObject:
        """Return the scene graph to be rendered."""
        self.require_open()
        if not self._query.HasValue(context):
            raise RobotError(
                f"input port {self.get_name()}.geometry_query is not connected: connect the query "
                "output port of the scene graph that holds what the cameras shall see"
            )
        query: Any = self._query.Eval(context)
        return query

    def _give_back(self) -> None:
        self.__cameras.clear()  # the maps of the lenses are megabytes

    def _develop(self, light: NDArray, time: float, camera: int) -> NDArray:
        """Apply gain and noise. BGR, 8 bits."""
        quality = self.quality
        if quality.noise == 0.0 and quality.gain == 1.0 and light.dtype == np.uint8:
            return light
        if quality.gain != 1.0:
            light = quality.gain * light.astype(np.float32)
        frame = round(time * quality.fps)
        rng = np.random.default_rng([*self._seed, 12, frame, camera])
        noise = _noise(light.size, quality.noise)
        start = rng.integers(0, len(noise) - light.size)
        return sum_of(light, noise[start : start + light.size].reshape(light.shape))


@lru_cache(maxsize=2)
def _noise(size: int, sigma: float) -> NDArray:
    """Return the noise of pictures of a size, each of which takes a part from anywhere."""
    # Drawing a million numbers anew takes as long as a tenth of the rendering.
    return sigma * np.random.default_rng(12).standard_normal(4 * size, dtype=np.float32)
