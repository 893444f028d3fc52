"""Nico before mirrors: its hand recorded directly and in every mirror, through rendered pixels."""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.dataset.dataset import Dataset
from nico_selfmodel.errors import EstimationError
from nico_selfmodel.files.csv_rows import number_of_word
from nico_selfmodel.model.cameras.mirror import Mirror
from nico_selfmodel.model.cameras.rig_parameters import SIDES
from nico_selfmodel.model.cameras.stereo_rig import StereoRig
from nico_selfmodel.model.self_model import SelfModel
from nico_selfmodel.names import check_name
from nico_selfmodel.planning.mirror_poses import MirrorPoses, plan_mirror_poses
from nico_selfmodel.planning.mirror_view import ENOUGH, MirrorView
from nico_selfmodel.planning.plans import Plan, commands_of_angles
from nico_selfmodel.recording.recorded_samples import RecordedSamples
from nico_selfmodel.recording.session import sample_pose
from nico_selfmodel.sessions.camera_scenario import RenderedNico
from nico_selfmodel.systems.rendering.mirror_scene import MirrorPlate, put_mirror
from nico_selfmodel.systems.stations.nico_station import NicoStation
from nico_selfmodel.systems.stations.station_body import StationBody
from nico_selfmodel.systems.tracking.reflection_detectors import default_mirror_detectors

DEFAULT_MIRROR = Mirror.from_values([0.0, np.radians(-20.0), 0.30])
"""A mirror before the robot's face, leaning back a little: it shows the right hand held up."""
SPARE = 2.0
"""Poses planned for each that is wanted: the true head is degrees off, and some hide the marker."""
_FAMILIAR = 120
"""Poses to choose from where those near familiar ones are preferred."""
_TRIES = 2
_LARGEST = 10.0
"""Width and height of a glass at most [m]."""
_NOISE = {"pixel_sigma": 0.3, "noise_sigma": 4e-3}
"""What choosing poses reckons with: a marker found in the image [px], an arm known [m]."""


class NicoBeforeMirrors:
    """A simulated Nico, and somebody who puts mirrors before it, one after the other.

    A mirror's place is meant before the left camera as designed: nobody can hold it more exactly.
    """

    def __init__(
        self,
        nico: RenderedNico,
        mirrors: Mapping[str, Mirror],
        *,
        plate: MirrorPlate | None = None,
        knows: SelfModel | None = None,
        rig: StereoRig | None = None,
        familiar: NDArray | None = None,
        choices: int = ENOUGH,
    ) -> None:
        """Choose where mirrors shall stand.

        Args:
            mirrors: Name -> where that mirror is meant to stand before the left camera.
            knows: What it has learned of arm and cameras: tells tape from its reflection.
            rig: Calibrated cameras, if known: fiducials are located behind their lenses.
            familiar: Readings at which the arm was learned: poses near them are preferred.
                Shape (K, n).
            choices: Poses from which to choose: the more joints, the farther apart they are.

        Raises:
            ModelError: If hardly any pose shows the hand in one of the mirrors.
        """
        self.nico, self.knows, self.rig = nico, knows, rig
        self.plate = plate or MirrorPlate()
        self.views = {
            name: MirrorView.of(
                nico.workspace,
                mirror,
                self.plate,
                np.random.default_rng((nico.seed, 21)),
                choices,
            )
            for name, mirror in mirrors.items()
        }
        if familiar is not None:
            with self.station(0) as station:
                q = nico.workspace.first_guess(station.joints).servos.to_joint(familiar)
            self.views = {name: view.near(q, _FAMILIAR) for name, view in self.views.items()}

    def station(self, session: int) -> NicoStation:
        """Return its station of one day, with a mirror that is still away."""
        found = default_mirror_detectors(self.rig)
        return NicoStation(
            self.nico.world,
            self.nico.seed,
            session,
            arm=self.nico.arm,
            detectors={marker: found[marker] for marker in self.nico.markers},
            quality=self.nico.quality,
            mirror=self.plate,
            knows=self.knows,
        )

    def plan(
        self,
        station: NicoStation,
        poses: int,
        direct: int,
        rng: np.random.Generator,
        best: bool,
        spare: float = SPARE,
        least: int | None = None,
    ) -> tuple[Plan, list[str]]:
        """Plan direct views, then every mirror, with some poses to spare.

        Args:
            poses: Wanted in each mirror.
            direct: Wanted without one.
            best: Choose the poses that tell most of a mirror; otherwise any.
            spare: Poses planned for each that is wanted.
            least: Poses that each mirror must have; all that are wanted if omitted.

        Returns:
            The plan, and the mirror of each pose, empty for none.

        Raises:
            EstimationError: If too few poses keep the arm off a glass.
        """
        plan = self.nico.plan(station, 0, direct, rng) if direct else []
        where = [""] * len(plan)
        arm = self.nico.arm
        guess = replace(self.nico.workspace.first_guess(station.joints), **_NOISE)
        limits = tuple(np.array([[j.lower, j.upper] for j in station.joints], dtype=float).T)
        for name, view in self.views.items():
            commands = commands_of_angles(station.joints, arm.lower, arm.upper, view.q)
            count = min(int(np.ceil(spare * poses)), len(commands))
            if best:
                try:
                    chosen = plan_mirror_poses(
                        guess, view.mirror, limits, count, rng, margin=0.0, candidates=commands
                    )
                except EstimationError as error:
                    # Some to spare are welcome, but not needed.
                    some = error.partial
                    commands = some.encoders if isinstance(some, MirrorPoses) else commands[:0]
                    if len(commands) < (poses if least is None else least):
                        raise
                else:
                    commands = chosen.encoders
            else:
                commands = rng.permutation(commands)[:count]
            plan += [("", command) for command in commands]
            where += [name] * len(commands)
        return plan, where

    def record(
        self,
        name: str,
        session: int,
        poses: int,
        direct: int = 0,
        *,
        best: bool = True,
        spare: float = SPARE,
        least: int | None = None,
        folder: Path | None = None,
        keep_images: bool = False,
        progress: Callable[[int, int], None] | None = None,
    ) -> Dataset:
        """Record the hand directly, then before every mirror.

        Args:
            session: Which day.
            poses: In each mirror, in which both cameras see the reflection of every marker.
            direct: Poses without a mirror, in which both cameras see every marker.
            best: Choose the poses that tell most of a mirror; otherwise any.
            spare: Poses planned for each that is wanted before a mirror, visited until that many
                show the hand to both cameras.
            least: Poses that each mirror must have, see `plan`.
            folder: Where to keep samples from the first one on; resumed if it is there.

        Returns:
            Rows of direct views and of reflections; the latter name their mirror.

        Raises:
            DataError: If nothing was seen at all, or the folder holds something else.
        """
        with self.station(session) as station:
            body = StationBody(station, station.joints, self.nico.markers, keep_images=keep_images)
            rng = np.random.default_rng((self.nico.seed, session, 22))
            plan, where = self.plan(station, poses, direct, rng, best, spare, least)
            kept = RecordedSamples(
                station.joints, self.nico.markers, self._about(station, name, session), folder
            )
            kept.resume(plan)
            standing = None
            with kept:
                for index, ((label, command), mirror) in enumerate(zip(plan, where, strict=True)):
                    found = kept.complete_in(mirror, index) if mirror else kept.free_poses(index)
                    if found < (poses if mirror else direct):
                        if mirror != standing:
                            X_BM = self.views[mirror].X_BM if mirror else None
                            put_mirror(station, body.context, X_BM)
                            standing = mirror
                        sample_pose(body, kept, index, label, command, _TRIES, mirror)
                    if progress:
                        progress(index + 1, len(plan))
        return kept.dataset()

    def look(self, session: int, mirror: str, command: NDArray) -> tuple[NDArray, NDArray]:
        """Go to a pose before a mirror and return what both cameras see.

        Args:
            session: Which day.
            command: Where to go [encoder units]. Shape (n,).

        Returns:
            Pictures of the left and the right camera, BGR. Shape (h, w, 3) each.
        """
        with self.station(session) as station:
            body = StationBody(station, station.joints, self.nico.markers)
            put_mirror(station, body.context, self.views[mirror].X_BM)
            body.move_and_measure(command)
            left, right = (station.picture(body.context, camera) for camera in SIDES)
        return left, right

    def _about(self, station: NicoStation, name: str, session: int) -> dict[str, object]:
        """Return what the data set says of itself."""
        places = [
            f"{mirror} at {1e3 * view.mirror.distance:.0f} mm, "
            + " and ".join(f"{angle:.0f}" for angle in np.degrees(view.mirror.values[:2]))
            + " deg"
            for mirror, view in self.views.items()
        ]
        nico = self.nico
        return {
            "name": name,
            "source": f"{station.world.origin('rendered nico', nico.seed, session)}, "
            f"mirrors: {'; '.join(places)}",
            "seed": nico.seed,
            "image_size": station.image_size,
        }


def mirrors_of_words(words: Iterable[str]) -> dict[str, Mirror]:
    """Read mirrors of different names, see `mirror_of_words`.

    Raises:
        ValueError: If a word is something else, or two have one name.
    """
    places = [mirror_of_words(word) for word in words]
    if len(dict(places)) < len(places):
        raise ValueError("two mirrors have one name: give each --mirror its own")
    return dict(places)


def mirror_of_words(words: str) -> tuple[str, Mirror]:
    """Read `ID=distance_mm,tilt_x_deg,tilt_y_deg`, or `ID` alone for `DEFAULT_MIRROR`.

    Raises:
        ValueError: If it is something else.
    """
    name, _, place = words.partition("=")
    if not name.strip():
        raise ValueError(f"--mirror {words}: a mirror needs a name, as in glass=300,0,-20")
    check_name(name.strip(), "the name of a mirror")
    if not place:
        return name.strip(), DEFAULT_MIRROR
    numbers = [number_of_word(word, f"--mirror {words}") for word in place.split(",")]
    if len(numbers) != 3 or not numbers[0] > 0.0:
        raise ValueError(
            f"--mirror {words}: expected ID=distance,tilt,tilt, a positive distance from the left "
            "camera [mm] and how far the glass is turned to the image's right and upwards [deg]"
        )
    return name.strip(), Mirror.from_values([*np.radians(numbers[1:]), 1e-3 * numbers[0]])


def plate_of_words(words: str | None) -> MirrorPlate:
    """Read `width_mm,height_mm` of a glass; that of a `MirrorPlate` where nothing is said.

    Raises:
        ValueError: If it is something else.
    """
    if words is None:
        return MirrorPlate()
    try:
        width, height = (1e-3 * float(word) for word in words.split(","))
        if max(width, height) > _LARGEST:
            raise ValueError(f"a glass has at most {_LARGEST:g} m")
        return MirrorPlate(width=width, height=height)
    except ValueError as error:
        raise ValueError(
            f"--glass-size {words}: expected width and height of a mirror [mm], as in 1400,1400"
        ) from error
