"""An arm and two cameras by the names of a self-model, as parameters of a tree.

The links of the tree are where the rows of the table begin, turned with their joints:

    X_1 = X_W0 Rz(zeta_1),   X_(i+1) = Tz(D_i) Tx(r_i) Rx(alpha_i) Ry(beta_i) Rz(zeta_(i+1)),
    zeta_i = -theta_offset_i / gear_i,

for theta = (encoder - theta_offset) / gear; the last row carries the tracked points. What bends is
the same but for where it is told from: loads in the frame after a row, ripple and couplings from
where a joint's displacement is zero, delta = offset / gear beyond the encoder's zero.
"""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.dataset.board_views import BoardViews
from nico_selfmodel.estimation.cameras.camera_adjustment import natural_scales
from nico_selfmodel.estimation.tree.tree_parameters import FRAME_PARTS, TreeParameters
from nico_selfmodel.geometry.rotation import rotation_about, rotation_vector_slope
from nico_selfmodel.geometry.transform import transform
from nico_selfmodel.model.arm.bending import COUPLING, HARMONICS, LOADS, RIPPLE, Bending
from nico_selfmodel.model.arm.dh_parameters import JOINT_PARTS, DhParameters
from nico_selfmodel.model.cameras.rig_parameters import SIDES
from nico_selfmodel.model.cameras.stereo_rig import StereoRig
from nico_selfmodel.model.tree.body_tree import BodyTree
from nico_selfmodel.model.tree.free_joints import resized

_X, _Y, _Z = np.eye(3)


@dataclass(frozen=True, eq=False)
class ArmParameters:
    """Names, values and derivatives, as `TreeParameters` has them for any body."""

    arm: DhParameters
    """Where the arm begins; what of it bends has names, too."""
    rig: StereoRig
    """Where the cameras begin, the left one at the world."""
    like: BodyTree
    """A tree of the same joints, markers and sensors, and of boards; its frames do not count."""

    @property
    def names(self) -> tuple[str, ...]:
        """Of the arm, the cameras, and what bends."""
        return self._names

    @cached_property
    def _names(self) -> tuple[str, ...]:
        return (*self.arm.names[: self._split], *self.rig.names, *self.arm.names[self._split :])

    @property
    def index(self) -> dict[str, int]:
        """Position of each name."""
        return self._index

    @cached_property
    def _index(self) -> dict[str, int]:
        return {name: i for i, name in enumerate(self.names)}

    @property
    def _split(self) -> int:
        """How many names a rigid arm has."""
        return 6 + 6 * len(self.arm.table.joints) + 3 * len(self.arm.table.markers)

    @property
    def bends(self) -> slice:
        """Where what bends is, at the end."""
        return slice(self._split + len(self.rig.names), None)

    @property
    def gears(self) -> NDArray:
        """Where the gears are. Shape (n,)."""
        return 6 + 6 * np.arange(len(self.arm.table.joints)) + JOINT_PARTS.index("gear")

    @property
    def start(self) -> NDArray:
        """Values of the arm and the cameras that these begin at. Shape (P,)."""
        rigid, bends = np.split(self.arm.values, [self._split])
        return np.concatenate([rigid, self.rig.values, bends])

    @property
    def base(self) -> BodyTree:
        """The tree that these begin at."""
        return self.layout.base

    @property
    def layout(self) -> TreeParameters:
        """Parameters of the tree, about where these begin."""
        return self._layout

    @cached_property
    def _layout(self) -> TreeParameters:
        return TreeParameters(self.tree_of(self.start))

    def arm_of(self, values: NDArray) -> DhParameters:
        """Return the arm. Shape (P,)."""
        return self.arm.with_values(np.append(values[: self._split], values[self.bends]))

    def rig_of(self, values: NDArray) -> StereoRig:
        """Return the cameras. Shape (P,)."""
        return self.rig.with_values(values[self._split : self.bends.start])

    def tree_of(self, values: NDArray) -> BodyTree:
        """Return the body with these values. Shape (P,)."""
        return arm_tree(self.arm_of(values), self.rig_of(values), self.like)

    def bending_of(self, values: NDArray) -> Bending | None:
        """Return what bends, as the self-model tells it."""
        return self.arm_of(values).bending

    def with_bending(self, bending: Bending | None) -> "ArmParameters":
        """Return the same of an arm in which something else bends."""
        return replace(self, arm=self.arm.with_bending(bending))

    def layout_values(self, values: NDArray) -> NDArray:
        """Return the values of `layout`. Shape (P,)."""
        return self.layout.values_of(self.tree_of(values))

    def by_name(self, values: NDArray, J: NDArray) -> NDArray:
        """Return derivatives by `names` of those by the names of `layout`. Shape (P, R)."""
        slopes = _Slopes(self, values).matrix()
        used = slopes.any(axis=1)
        return slopes[used].T @ J[used]

    def scales(self, size: float) -> NDArray:
        """Return the scale of each parameter on which its sigma says whether it is known at all.

        Args:
            size: What lengths are held against [m].
        """
        arm = dict(zip(self.arm.names, self.arm.scales(size).tolist(), strict=True))
        # A board as large as the workspace, for the scales of the cameras.
        corners = size * np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0]])
        sizes = tuple(camera.image_size for camera in self.rig.cameras)
        views = BoardViews(corners, (), SIDES, np.zeros((0, 2, 4)), sizes)
        names = self.rig.names
        found = natural_scales(names, views, self.rig.values, names).tolist()
        scale = arm | dict(zip(names, found, strict=True))
        return np.array([scale[name] for name in self.names])


def arm_tree(arm: DhParameters, rig: StereoRig, like: BodyTree) -> BodyTree:
    """Return an arm and two cameras as a tree.

    Args:
        arm: Rows, servos, what bends.
        rig: The cameras, the left one at the world.
        like: A tree of the same joints, markers and sensors.
    """
    table, n = arm.table, len(arm.table.joints)
    rows = _rows(arm)
    frames = np.concatenate([table.X_W0[None], rows[:-1]])
    X, gear = like.X_PJ.copy(), like.gear.copy()
    X[:n] = frames @ transform(rotation_about(_Z, _zeros(arm)), np.zeros((n, 3)))
    gear[:n] = arm.gears
    p = table.p_NH @ rows[-1, :3, :3].T + rows[-1, :3, 3]
    hands = tuple(
        replace(marker, X_LA=transform(np.eye(3), place))
        for marker, place in zip(like.markers, p, strict=False)
    )
    poses: dict[str, NDArray] = dict(zip(SIDES, (np.eye(4), rig.X_LR), strict=True))
    return replace(
        like,
        X_PJ=X,
        gear=gear,
        markers=(*hands, *like.markers[len(p) :]),
        sensors=tuple(replace(s, X_LA=poses[s.name]) for s in like.sensors),
        lenses=dict(zip(SIDES, rig.cameras, strict=True)),
        bending=None if arm.bending is None else _bending_of_tree(arm, like.joints),
    )


def _rows(arm: DhParameters) -> NDArray:
    """Return Tz(D) Tx(r) Rx(alpha) Ry(beta) of each row. Shape (n, 4, 4)."""
    rows = arm.table.links.copy()
    rows[:, 2, 3] += arm.table.D
    return rows


def _beyond_zero(arm: DhParameters) -> NDArray:
    """Return delta, how far a joint is displaced where its encoder reads zero, negated. (n,)."""
    return np.asarray(arm.servos.offset / arm.gears)


def _zeros(arm: DhParameters) -> NDArray:
    """Return zeta of each joint. Shape (n,)."""
    delta = _beyond_zero(arm)
    zeta = arm.table.theta_zero - delta
    return zeta if arm.bending is None else zeta - arm.bending.coupling @ delta


def _bending_of_tree(arm: DhParameters, joints: tuple[str, ...]) -> Bending:
    """Return what bends, told from the links of the tree."""
    bending = arm.bending
    assert bending is not None
    loads = (arm.table.links[:, :3, :3] @ bending.loads[:, :, None])[:, :, 0]
    turned = np.einsum("ihab,ihb->iha", _phases(arm), bending.ripple)
    return resized(replace(bending, loads=loads, ripple=turned), joints)


def _phases(arm: DhParameters) -> NDArray:
    """Return what takes a ripple of q - delta to one of q, by harmonic. Shape (n, 2, 2, 2).

    a sin h (q - d) + b cos h (q - d) = (a cos hd + b sin hd) sin hq + (b cos hd - a sin hd) cos hq
    """
    angle = _beyond_zero(arm)[:, None] * np.array(HARMONICS)
    c, s = np.cos(angle), np.sin(angle)
    return np.stack([np.stack([c, s], axis=-1), np.stack([-s, c], axis=-1)], axis=-2)


class _Slopes:
    """Derivatives of a tree's parameters by those of arm and cameras, at some values."""

    def __init__(self, parameters: ArmParameters, values: NDArray) -> None:
        self.of, self.arm = parameters, parameters.arm_of(values)
        self.layout = parameters.layout
        self.turns = np.linalg.inv(self.layout.turn_slopes(parameters.layout_values(values)))
        self.back = np.swapaxes(self.layout.frames[:, :3, :3], 1, 2)
        self.out = np.zeros((len(self.layout.names), len(parameters.names)))
        self.ways = _rows(self.arm)[:, :3, :3]
        count = len(self.arm.table.markers)
        self.hands = self.layout.frame_of[:count]
        self.places = self.arm.table.p_NH @ self.ways[-1].T

    def matrix(self) -> NDArray:
        """Return all of them. Shape (P of the layout, P)."""
        self._base()
        for i, joint in enumerate(self.arm.table.joints):
            self._zero(i, joint)
            self._row(i, joint)
        for m, marker in enumerate(self.arm.table.markers):
            for k, axis in enumerate("xyz"):
                self._shift(self.hands[m], f"hand.{marker}.{axis}", self.ways[-1, :, k])
        self._cameras()
        if self.arm.bending is not None:
            self._bends(self.arm.bending)
        return self.out

    def _turn(self, frame: int, name: str, axis: NDArray, by: float = 1.0) -> None:
        self.out[6 * frame : 6 * frame + 3, self.of.index[name]] += by * (self.turns[frame] @ axis)

    def _shift(self, frame: int, name: str, way: NDArray) -> None:
        self.out[6 * frame + 3 : 6 * frame + 6, self.of.index[name]] += self.back[frame] @ way

    def _base(self) -> None:
        slope = rotation_vector_slope(self.arm.base_turn)
        for k, axis in enumerate("xyz"):
            self._shift(0, f"M0.{axis}", np.eye(3)[k])
            self._turn(0, f"M0.r{axis}", slope[:, k])

    def _axis(self, i: int) -> NDArray:
        """Return a joint's axis on the link that carries it. Shape (3,)."""
        return self.arm.table.X_W0[:3, 2] if i == 0 else self.ways[i - 1, :, 2]

    def _zero(self, i: int, joint: str) -> None:
        gear = float(self.arm.gears[i])
        offset = float(self.arm.servos.offset[i] - gear * self.arm.table.theta_zero[i])
        self._turn(i, f"{joint}.theta_offset", self._axis(i), -1.0 / gear)
        self._turn(i, f"{joint}.gear", self._axis(i), offset / gear**2)
        self.out[self.layout.gears.start + i, self.of.index[f"{joint}.gear"]] = 1.0

    def _row(self, i: int, joint: str) -> None:
        across = rotation_about(_X, self.arm.table.alpha[i]) @ _Y
        ways, turns = {"D": _Z, "r": _X}, {"alpha": _X, "beta": across}
        if i + 1 < len(self.ways):
            for part, way in ways.items():
                self._shift(i + 1, f"{joint}.{part}", way)
            for part, axis in turns.items():
                self._turn(i + 1, f"{joint}.{part}", axis)
            return
        for frame, place in zip(self.hands, self.places, strict=True):
            for part, way in ways.items():
                self._shift(frame, f"{joint}.{part}", way)
            for part, axis in turns.items():
                self._shift(frame, f"{joint}.{part}", np.cross(axis, place))

    def _cameras(self) -> None:
        of = self.layout.index
        for name in self.of.rig.names:
            camera, *pose, part = name.split(".")
            assert bool(pose) == (part in FRAME_PARTS)
            self.out[of[f"{camera}.{part}"], self.of.index[name]] = 1.0

    def _bends(self, bending: Bending) -> None:
        joints, of = bending.joints, self.layout.index
        for name in bending.names:
            self.out[of[name], self.of.index[name]] = 1.0
        if LOADS in bending.effects:
            self._blocks(bending.names_of(LOADS), self.arm.table.links[:, :3, :3])
        if RIPPLE in bending.effects:
            self._blocks(bending.names_of(RIPPLE), _phases(self.arm).reshape(-1, 2, 2))
        if COUPLING in bending.effects:
            delta = _beyond_zero(self.arm)
            for i, joint in enumerate(joints):
                for j, other in enumerate(joints):
                    if i != j:
                        name = f"{joint}.{COUPLING}_{other}"
                        self._turn(i, name, self._axis(i), -float(delta[j]))

    def _blocks(self, names: tuple[str, ...], turns: NDArray) -> None:
        """Fill in what numbers that stand together turn into. Shape (blocks, k, k)."""
        size = turns.shape[1]
        for b, turn in enumerate(turns):
            own = names[size * b : size * b + size]
            rows = [self.layout.index[name] for name in own]
            columns = [self.of.index[name] for name in own]
            self.out[np.ix_(rows, columns)] = turn
