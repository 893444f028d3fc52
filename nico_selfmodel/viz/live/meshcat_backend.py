"""A scene on a running `meshcat-server`, where it outlives the script (PyPI's meshcat package)."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.errors import SelfModelError
from nico_selfmodel.geometry.transform import transform
from nico_selfmodel.viz.live.meshing import mesh_of
from nico_selfmodel.viz.live.paint import AMBIENT, BACKGROUND, paint
from nico_selfmodel.viz.live.picture_mesh import picture_object
from nico_selfmodel.viz.scene.scene import FIELD_OF_VIEW, ROOT, Camera, Scene
from nico_selfmodel.viz.scene.scene_items import (
    Box,
    Capsule,
    Cylinder,
    Ellipsoid,
    Item,
    Picture,
    Segments,
)

DEFAULT_URL = "tcp://127.0.0.1:6000"
"""Where `meshcat-server` listens unless told otherwise."""

# three.js cylinders lie along y, ours along z; and its cameras have y up.
_Z_FROM_Y = transform([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]], np.zeros(3))


def publish(scene: Scene, url: str = DEFAULT_URL, *, timeout: float = 4.0) -> str:
    """Draw a scene on a meshcat server, in place of the one drawn before.

    Args:
        url: The server's ZMQ address, as it prints it.
        timeout: How long to wait for each answer [s].

    Returns:
        The address of the page to look at.

    Raises:
        SelfModelError: If the address is not valid, or nothing there answers as a meshcat server.
    """
    window = _Window(url, timeout)
    try:
        web_url = window.web_url()
        _draw_scene(window, scene)
    finally:
        window.close()
    return web_url


class _Window:
    """The way to a server, in place of meshcat's own, which waits for ever where none answers."""

    def __init__(self, url: str, timeout: float) -> None:
        # Imported late: most runs never need it, and it starts an event loop's machinery.
        from meshcat.visualizer import umsgpack, zmq

        self._url, self._zmq, self._pack = url, zmq, umsgpack.packb
        self._context = zmq.Context()
        self._socket = self._context.socket(zmq.REQ)
        for option in (zmq.RCVTIMEO, zmq.SNDTIMEO):
            self._socket.setsockopt(option, int(1e3 * timeout))
        self._socket.setsockopt(zmq.LINGER, 0)
        try:
            self._socket.connect(url)
        except zmq.ZMQError as error:
            self.close()
            raise SelfModelError(
                f"{url!r} is not an address of a meshcat server ({error}): give the zmq_url that "
                f"meshcat-server prints, for example {DEFAULT_URL}"
            ) from error

    def close(self) -> None:
        self._socket.close()
        self._context.term()

    def web_url(self) -> str:
        answer = self._ask([b"url"]).decode("utf-8", errors="replace")
        if not answer.startswith(("http:", "https:")):
            raise SelfModelError(
                f"what listens at {self._url} is not a meshcat server: it answered {answer[:60]!r}"
            )
        return answer

    def send(self, command: Any) -> None:
        """Send a command of meshcat; the name and the argument are those its Visualizer expects."""
        data = command.lower()
        frames = [data["type"].encode(), data["path"].encode(), self._pack(data)]
        answer = self._ask(frames)
        if answer != b"ok":
            raise SelfModelError(f"the meshcat server at {self._url} answered {answer[:80]!r}")

    def _ask(self, frames: list[bytes]) -> bytes:
        try:
            self._socket.send_multipart(frames)
            return self._socket.recv()
        except self._zmq.ZMQError as error:
            raise SelfModelError(
                f"no meshcat server answers at {self._url}: start one with `meshcat-server`, and "
                "give the zmq_url that it prints"
            ) from error


def _draw_scene(window: _Window, scene: Scene) -> None:
    import meshcat

    viewer = meshcat.Visualizer(window=window)
    viewer[ROOT].delete()
    for path in ("/Grid", "/Axes"):
        viewer[path].set_property("visible", False)
    for key, color in BACKGROUND.items():
        viewer["/Background"].set_property(key, list(color))
    viewer["/Lights/AmbientLight/<object>"].set_property("intensity", 0.5 * AMBIENT)
    for item in scene.items:
        place = viewer[f"{ROOT}/{item.path}"]
        _draw(place, item)
        if not np.array_equal(item.X_WI, np.eye(4)):
            place.set_transform(item.X_WI)
    _look(viewer, scene.camera)


def _draw(place: Any, item: Item) -> None:
    import meshcat.geometry as shapes

    material = shapes.MeshPhongMaterial(**paint(item.color))
    if isinstance(item, Segments):
        points = np.stack([item.starts, item.ends], axis=1).reshape(-1, 3)
        line = shapes.LineBasicMaterial(**paint(item.color))
        geometry = shapes.PointsGeometry(points.T.astype(np.float32))
        place.set_object(shapes.LineSegments(geometry, line))
    elif isinstance(item, Ellipsoid):
        place.set_object(shapes.Ellipsoid(item.radii), material)
    elif isinstance(item, Box):
        place.set_object(shapes.Box(item.sides.tolist()), material)
    elif isinstance(item, Cylinder):
        _rod(place, item.length, item.radius, material)
    elif isinstance(item, Picture):
        place.set_object(picture_object(item))
    elif isinstance(item, Capsule):
        _rod(place["side"], item.length, item.radius, material)
        for name, sign in (("bottom", -0.5), ("top", 0.5)):
            place[name].set_object(shapes.Sphere(item.radius), material)
            place[name].set_transform(transform(np.eye(3), [0.0, 0.0, sign * item.length]))
    else:
        mesh = mesh_of(item)
        geometry = shapes.TriangularMeshGeometry(mesh.vertices, mesh.faces, mesh.colors)
        look = paint(item.color)
        if mesh.colors is not None:
            look |= {"color": 0xFFFFFF, "vertexColors": True}
        place.set_object(geometry, shapes.MeshPhongMaterial(flatShading=True, **look))


def _rod(place: Any, length: float, radius: float, material: Any) -> None:
    import meshcat.geometry as shapes

    place["rod"].set_object(shapes.Cylinder(length, radius), material)
    place["rod"].set_transform(_Z_FROM_Y)


def _look(viewer: Any, camera: Camera) -> None:
    """Place camera and scene: the viewer's camera can only turn about its own origin.

    So the scene's root moves, and the scene's frame W is no longer the viewer's.
    """
    import meshcat.geometry as shapes

    viewer[ROOT].set_transform(transform(np.eye(3), -camera.p_WT))
    rig = viewer["/Cameras/default/rotated"]
    fov = float(np.degrees(FIELD_OF_VIEW))
    rig.set_object(shapes.PerspectiveCamera(fov=fov, near=0.01, far=100.0))
    rig["<object>"].set_property("position", _y_up(camera.p_WC - camera.p_WT).tolist())


def _y_up(p: NDArray) -> NDArray:
    return _Z_FROM_Y[:3, :3].T @ p
