"""What learned mirrors look like: cameras, glass, hand and reflection, and the rays between."""

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.estimation.mirrors.mirror import MirrorCalibration
from nico_selfmodel.geometry.transform import apply, inverse
from nico_selfmodel.model.cameras.mirror import Mirror
from nico_selfmodel.model.cameras.mirror_rig import MirrorRig
from nico_selfmodel.model.cameras.stereo_rig import StereoRig
from nico_selfmodel.names import called
from nico_selfmodel.viz.figures import palette
from nico_selfmodel.viz.scene.camera_items import ImagePlane, camera_items
from nico_selfmodel.viz.scene.mirror_picture import MirrorPicture, Pictures, on_glass, plate_items
from nico_selfmodel.viz.scene.robot.robot_items import robot_items
from nico_selfmodel.viz.scene.scene import LegendEntry, Scene, path_names
from nico_selfmodel.viz.scene.scene_items import Item, Markers, Segments, Tube
from nico_selfmodel.viz.scene.surroundings import (
    X_WL,
    camera_from,
    floor_items,
    turned,
    upright,
    with_room,
)

if TYPE_CHECKING:
    from nico_selfmodel.plant import ArmDescription

_DOT = 0.004
_PLANE = 0.045
"""Distance of image planes from their cameras [m]."""
_MARGIN = 0.03
"""Glass drawn beyond where it was looked into [m]."""
_PICTURED = 0.07
"""The same where it carries a picture, which shows more than the hand [m]."""
_BEHIND = 0.002
"""How far behind its picture the glass is drawn [m]."""
_RAY = 0.0011
"""Radius of a ray [m]."""
_RAYS = 3
"""Poses of each mirror whose rays are drawn."""
_GLASS, _REFLECTED = palette.rgba("#8fb4d9", 0.45), palette.rgba("#4477aa", 0.75)
_AZIMUTH, _ELEVATION = np.radians(235.0), np.radians(32.0)
_ROOM = 0.1
"""Left around the places of a robot's links for their shapes, in units of its size."""
_FROM_BEHIND = np.radians(217.0)
"""Over the shoulder of a robot that is drawn, into the glass."""


def mirror_scene(
    calibration: MirrorCalibration,
    pictures: Pictures | None = None,
    robot: "ArmDescription | None" = None,
) -> Scene:
    """Describe learned mirrors as a scene; z is up.

    Args:
        pictures: What was seen in the mirrors, if pictures were kept: the glass shows them.
        robot: The robot that looked, if it is known: it is drawn as it stood for the first one.

    Returns:
        Cameras and their reflections, a plate for each mirror, the hand where the arm says it is
        and where its reflections appear, and for some poses the rays from the hand over the glass
        into both cameras. Outliers are red.
    """
    pictures = pictures or {}
    rig = StereoRig(*calibration.solution.reflections.cameras)
    model = calibration.model
    shown = robot is not None and bool(pictures)
    X_SW = upright(model, robot) if shown else X_WL @ inverse(rig.left.X_WC)
    cameras = rig.moved(inverse(X_SW))
    planes = {
        side: ImagePlane(camera, _PLANE)
        for side, camera in zip(("left", "right"), cameras.cameras, strict=True)
    }
    items: list[Item] = []
    for side, plane in planes.items():
        items += camera_items(side, plane, None)
    points = [plane.corners for plane in planes.values()]
    names = path_names(calibration.mirrors)
    for name, (known, mirror) in zip(names, calibration.mirrors.items(), strict=True):
        rig_here = MirrorRig(cameras, mirror)
        found, seen = _mirror_items(name, calibration, known, rig_here, pictures.get(known))
        items += found
        points.append(seen)
    if robot is not None and shown:
        q = model.servos.to_joint(next(iter(pictures.values())).encoders)
        body = turned(robot_items(robot, model, q), X_SW)
        items += body
        places = np.array([item.X_WI[:3, 3] for item in body])
        points.append(with_room(places, _ROOM * float(np.linalg.norm(np.ptp(places, axis=0)))))
    everything = np.concatenate(points)
    grid, *_ = floor_items(everything, 1.0)
    azimuth = _FROM_BEHIND if shown else _AZIMUTH
    view = camera_from(everything, float(azimuth), float(_ELEVATION))
    return Scene(calibration.model.name, (grid, *items), view, _legend(calibration))


def _mirror_items(
    path: str,
    calibration: MirrorCalibration,
    name: str,
    rig: MirrorRig,
    picture: MirrorPicture | None,
) -> tuple[list[Item], NDArray]:
    """Return the items of one mirror, and points that the first view must hold."""
    solution = calibration.solution
    rows = solution.reflections.mirror == solution.reflections.mirrors.index(name)
    X_SL = rig.rig.left.X_WC
    hand = apply(X_SL, solution.reflections.p_LQ[rows])
    inliers = ~solution.outliers[rows]
    virtual = apply(X_SL, rig.mirror.reflect(solution.reflections.p_LQ[rows]))
    plate = _plate(rig, virtual, _MARGIN if picture is None else _PICTURED)
    color = _GLASS if picture is None else palette.rgba(palette.MUTED)
    glass = plate if picture is None else plate - _BEHIND * rig.plane.normal
    items = plate_items(f"mirrors/{path}", plate, glass, color, 0.4 * _DOT)
    for kind, points, color in (("hand", hand, palette.HAND), ("reflection", virtual, None)):
        for label, chosen in (("inliers", inliers), ("outliers", ~inliers)):
            if chosen.any():
                shade = _REFLECTED if color is None else palette.rgba(color)
                shade = palette.rgba(palette.OUTLIER) if label == "outliers" else shade
                place = f"mirrors/{path}/{kind}_{label}"
                items.append(Markers(path=place, color=shade, centers=points[chosen], radius=_DOT))
    shown = np.linspace(0, inliers.sum() - 1, min(_RAYS, inliers.sum())).astype(int)
    if picture is not None:
        image = picture.images[0][:, :, ::-1]
        items.append(on_glass(f"mirrors/{path}/picture", rig.rig.left, plate, image))
        samples = solution.reflections.sample[rows][inliers]
        shown = (
            np.flatnonzero(samples == picture.sample)[:1] if picture.sample in samples else shown
        )
    items += _rays(path, rig, hand[inliers][shown], virtual[inliers][shown])
    items += _reflected_cameras(path, rig)
    centers = np.stack([camera.X_WC[:3, 3] for camera in rig.virtual.cameras])
    return items, np.concatenate([plate, hand, virtual, centers])


def _plate(rig: MirrorRig, virtual: NDArray, margin: float) -> NDArray:
    """Return the corners of the glass that lines of sight go through. Shape (4, 3)."""
    meets = np.concatenate([rig.plane.met_between(center, virtual) for center in _centres(rig.rig)])
    normal = rig.plane.normal
    across = np.cross([0.0, 0.0, 1.0], normal)
    across = across / np.linalg.norm(across) if np.linalg.norm(across) > 1e-6 else X_WL[:3, 0]
    axes = np.stack([across, np.cross(normal, across)])
    flat = meets @ axes.T
    low, high = flat.min(axis=0) - margin, flat.max(axis=0) + margin
    foot = -rig.plane.offset * normal
    corners = np.array([[low[0], low[1]], [high[0], low[1]], high, [low[0], high[1]]])
    return foot + corners @ axes


def _rays(path: str, rig: MirrorRig, hand: NDArray, virtual: NDArray) -> list[Item]:
    """Return rays from hand over glass to the cameras, and on to the reflections behind it."""
    items: list[Item] = []
    if not len(hand):
        return items
    for side, center in zip(("left", "right"), _centres(rig.rig), strict=True):
        meets = rig.plane.met_between(center, virtual)
        centers = np.repeat(center[None], len(hand), axis=0)
        color = palette.CAMERAS[side]
        for kind, starts, ends, opacity in (
            ("from_hand", hand, meets, 1.0),
            ("to_camera", meets, centers, 1.0),
            ("behind", meets, virtual, 0.4),
        ):
            items.append(
                Segments(
                    path=f"mirrors/{path}/rays/{side}_{kind}",
                    color=palette.rgba(color, opacity),
                    starts=starts,
                    ends=ends,
                )
            )
        for k, points in enumerate(np.stack([hand, meets, centers], axis=1)):
            place = f"mirrors/{path}/rays/{side}_{k + 1}"
            shade = palette.rgba(color)
            items.append(Tube(path=place, color=shade, points=points, radius=_RAY))
    return items


def _reflected_cameras(path: str, rig: MirrorRig) -> list[Item]:
    """Return the frusta of the reflected cameras, which see the hand as the cameras see it."""
    items: list[Item] = []
    for side, camera in zip(("left", "right"), rig.virtual.cameras, strict=True):
        plane = ImagePlane(camera, _PLANE)
        center = np.repeat(camera.X_WC[None, :3, 3], 4, axis=0)
        starts = np.concatenate([center, plane.corners])
        ends = np.concatenate([plane.corners, np.roll(plane.corners, -1, axis=0)])
        color = palette.rgba(palette.CAMERAS[side], 0.6)
        items.append(
            Segments(path=f"mirrors/{path}/reflected_{side}", color=color, starts=starts, ends=ends)
        )
    return items


def _centres(rig: StereoRig) -> list[NDArray]:
    return [camera.X_WC[:3, 3] for camera in rig.cameras]


def _legend(calibration: MirrorCalibration) -> tuple[LegendEntry, ...]:
    entries = [
        LegendEntry(
            "left camera, its rays and its reflection", palette.rgba(palette.CAMERAS["left"])
        ),
        LegendEntry(
            "right camera, its rays and its reflection", palette.rgba(palette.CAMERAS["right"])
        ),
        *(LegendEntry(_words(name, m), _GLASS) for name, m in calibration.mirrors.items()),
        LegendEntry("hand, where the arm says it is", palette.rgba(palette.HAND)),
        LegendEntry("its reflection behind the glass", _REFLECTED),
    ]
    if calibration.solution.outliers.any():
        entries.append(LegendEntry("outliers", palette.rgba(palette.OUTLIER)))
    return tuple(entries)


def _words(name: str, mirror: Mirror) -> str:
    return f"{called('mirror', name)}, {1e3 * mirror.distance:.0f} mm from the left camera"
