"""Nico at work, live: sliders move its joints, its self-model predicts what its cameras see."""

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.errors import ModelError
from nico_selfmodel.geometry.transform import inverse
from nico_selfmodel.model.cameras.mirror import Mirror
from nico_selfmodel.model.cameras.rig_parameters import SIDES
from nico_selfmodel.model.self_model import SelfModel
from nico_selfmodel.plant import ArmDescription
from nico_selfmodel.sessions.camera_scenario import RenderedNico
from nico_selfmodel.sessions.live_station import LiveStation
from nico_selfmodel.sessions.mirrors.nico_before_mirrors import DEFAULT_MIRROR, NicoBeforeMirrors
from nico_selfmodel.systems.rendering.mirror_scene import put_mirror
from nico_selfmodel.systems.simulated.imperfections import Imperfections
from nico_selfmodel.systems.stations.station_body import StationBody
from nico_selfmodel.viz.live.station_mirror import StandingGlass
from nico_selfmodel.viz.live.station_view import StationView

_DAY = 99
_CHOICE = 12
"""Poses in view of which the one nearest to the images' middles is shown first."""
ELSEWHERE_M, ELSEWHERE = 0.04, np.radians(10.0)
"""A learned mirror farther from where it is put stood elsewhere; heads are degrees off."""
_TURNED = np.radians(1.0)
"""A joint held farther from where it was while learning is another pose."""


class Watching(LiveStation[StationView, NDArray]):
    """One arm before a head that stands still; closing gives the station back."""

    def __init__(
        self,
        model: SelfModel,
        world: Imperfections,
        seed: int,
        *,
        mirror: tuple[str, Mirror | None] | None = None,
        recording: bool = False,
    ) -> None:
        """Wake the robot up and draw it.

        Args:
            model: What it has learned: arm and cameras.
            seed: Which robot; the one that learned the model.
            mirror: A mirror that the model knows and where it is put before the left camera as
                designed; None as place for where `learn --mirror` puts it.

        Raises:
            ModelError: If the model lacks arm, cameras or that mirror, or tracks something else; or
                if the mirror was learned at another place and nobody says where to put it; or if
                its head was turned elsewhere, so that it knows nothing of what these cameras see.
        """
        if mirror is not None:
            _check_mirror(model, *mirror)
        self.marker = model.markers[0]
        self._nico = RenderedNico(world, seed, (self.marker,))
        self._nico.arm.check_joints(model.joints)
        _check_head(model, self._nico.arm)
        self._before = None if mirror is None else _before(self._nico, model, *mirror)
        self.station = (
            self._nico.station(_DAY, model.rig)
            if self._before is None
            else self._before.station(_DAY)
        )
        self.body = StationBody(self.station, self.station.joints, (self.marker,))
        self.model = model
        glass = None if self._before is None else self._put_glass(self._before)
        self.mirror = None if glass is None else glass.mirror
        self.view = StationView(self._nico.arm, model, glass=glass, recording=recording)

    def _put_glass(self, before: NicoBeforeMirrors) -> StandingGlass:
        ((name, view),) = before.views.items()
        put_mirror(self.station, self.body.context, view.X_BM)
        X_RM = inverse(before.nico.arm.links.X_BR) @ view.X_BM
        return StandingGlass(name, X_RM, before.plate.width, before.plate.height)

    def show(self) -> NDArray:
        """Show the station as it is now.

        Returns:
            Distance of the predicted from the tracked pixels in each camera, then the same of the
            reflection where there is a mirror; nan where not seen [px]. Shape (2,) or (4,).
        """
        context = self.body.context
        readings = self._read("encoders")
        pixels = self._read("pixels")
        images = [self.station.picture(context, camera) for camera in SIDES]
        p_WH = self.model.predict(readings).p_WH
        expected = self.model.rig.project(p_WH)[0]
        if self.mirror is None:
            self.view.show(readings, images, pixels)
            return np.linalg.norm((pixels - expected).reshape(2, 2), axis=1)
        reflected = self._read("reflected_pixels")
        self.view.show(readings, images, pixels, reflected)
        behind = self.model.mirror_rig(self.mirror).project(p_WH)[0]
        miss = np.concatenate([pixels - expected, reflected - behind])
        return np.linalg.norm(miss.reshape(4, 2), axis=1)

    def go_into_view(self) -> None:
        """Go where the cameras see the hand well, and its reflection if there is one."""
        commands = self._in_view(_CHOICE)
        p_WH = self.model.predict(np.array(commands)).p_WH
        sizes = np.array([camera.image_size for camera in self.model.rig.cameras])
        off = self.model.rig.project(p_WH).reshape(-1, 2, 2) - 0.5 * sizes
        farthest = np.linalg.norm(off / sizes, axis=2).max(axis=1)
        # What a model puts into the images' middles may still turn its marker away from a camera.
        for k in np.argsort(np.where(np.isnan(farthest), np.inf, farthest), kind="stable"):
            self.body.move_and_measure(commands[k])
            if np.isfinite(self.show()[:2]).all():
                break

    def _in_view(self, count: int) -> list[NDArray]:
        """Return commands of poses in view, in the mirror if there is one."""
        rng = np.random.default_rng(7)
        if self._before is None:
            plan = self._nico.plan(self.station, 0, count, rng)
        else:
            plan, _ = self._before.plan(self.station, count, 0, rng, best=False)
        return [command for _, command in plan[:count]]

    def _to_joint(self, readings: NDArray) -> NDArray:
        return self.model.servos.to_joint(readings)

    def _to_encoder(self, angles: NDArray) -> NDArray:
        return self.model.servos.to_encoder(angles)


def _before(
    nico: RenderedNico, model: SelfModel, name: str, place: Mirror | None
) -> NicoBeforeMirrors:
    return NicoBeforeMirrors(nico, {name: place or DEFAULT_MIRROR}, knows=model, rig=model.rig)


def _check_head(model: SelfModel, arm: ArmDescription) -> None:
    """Refuse a model that was learned with joints of the head or the hand held elsewhere."""
    for joint, held in model.robot.get("held", {}).items():
        here = arm.held.get(joint, held)
        if abs(here - held) > _TURNED:
            raise ModelError(
                f"self-model {model.name!r} was learned with {joint} at {np.degrees(held):.0f} "
                f"deg, and this Nico holds it at {np.degrees(here):.0f} deg: learn it anew with "
                "`nico-selfmodel learn`"
            )


def _check_mirror(model: SelfModel, name: str, place: Mirror | None) -> None:
    """Refuse mirrors that the model does not know, and guesses about where they stood.

    Raises:
        ModelError: Saying which there are, or where it was learned to stand.
    """
    learned = model.mirror_rig(name).mirror
    if place is not None:
        return
    apart = abs(learned.distance - DEFAULT_MIRROR.distance)
    if apart > ELSEWHERE_M or learned.angle_to(DEFAULT_MIRROR) > ELSEWHERE:
        tilt_x, tilt_y = np.degrees(learned.values[:2])
        raise ModelError(
            f"mirror {name!r} was learned {1e3 * learned.distance:.0f} mm before the left camera, "
            f"turned by {tilt_x:.0f} and {tilt_y:.0f} deg, not where `learn --mirror` puts one: "
            f"say where to put it as it was recorded, --mirror {name}=MM,DEG,DEG"
        )
