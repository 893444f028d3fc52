"""Which numbers of lenses a recording contradicts, of all cameras whose lenses were held.

One number at a time goes where the squares of the residuals fall most, S to S - g, with what went
before it; none more where chance does as much. Others that leave S' say as much where n log of S'
over what the best one leaves is less than twice the logarithm of the odds: they are not told apart.
Where none goes the focal length of each camera, which zoom and focus change, is asked by itself: it
is doubted where chance does as much more often, and that is no fault.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.estimation.results.calibration_result import CAUSE, WARNING, Finding
from nico_selfmodel.estimation.tree.forward.tree_linear import TreeLinear
from nico_selfmodel.estimation.tree.tree_problem import TreeProblem
from nico_selfmodel.model.cameras.camera import Camera
from nico_selfmodel.names import listed
from nico_selfmodel.optimization.chi_square import chi_square_tail

NUMBERS = ("fx", "fy", "cx", "cy", "k1")
"""Numbers of a lens that are asked for one by one."""
FOCAL, SIZE = "focal length", "size of pictures"
"""What is asked for besides: fx and fy as one, and with cx and cy, by logarithms of factors."""
_TOGETHER = {FOCAL: ("fx", "fy"), SIZE: ("fx", "fy", "cx", "cy")}
TOLD = 1e-3
"""Share of a column that must be left beside what was free for it to be told apart."""
CHANCE = 1e-6
"""How often noise alone may contradict what is held."""
DOUBTED = 1e-4
"""How often noise alone may let the focal length of some camera be doubted."""
_ODDS = 100.0
"""Odds below which two numbers are not told apart."""
_MOST = 4
"""Numbers that are named; where there are more, no single one is wrong."""
_NOTABLE, _VAGUE = 0.005, 0.1
"""Shares of the focal length by which a picture's points must move to be worth a word, and to which
that must be known."""
_SHARE = 0.03
"""Part of a camera's squares from which on a number is a fault."""
_SEVERAL = (
    "lenses or rows of two cameras exchanged, pictures of another size, or lenses that are not "
    "exact"
)


@dataclass(frozen=True, eq=False)
class LensPart:
    """A number of a lens that the recording contradicts."""

    camera: str
    """Whose lens."""
    part: str
    """One of `NUMBERS`, `FOCAL` or `SIZE`."""
    gain: float
    """Fall of the whitened squares if it were free, in units of their mean."""
    value: float
    """Where it would go, from where it is held; of `FOCAL` and `SIZE` the factor's logarithm."""
    sigma: float
    """Standard deviation of that."""
    scalars: int
    """How many numbers the camera measured."""
    others: "tuple[LensPart, ...]" = field(default=())
    """What would do as well, and is not told apart from it."""
    doubted: bool = False
    """Whether it is not surely wrong."""

    @property
    def parts(self) -> tuple[str, ...]:
        """Names of the numbers that would go."""
        return tuple(f"{self.camera}.{part}" for part in _TOGETHER.get(self.part, (self.part,)))

    @property
    def severity(self) -> str:
        """How much this says against what is held."""
        return CAUSE if self.gain > _SHARE * self.scalars and not self.doubted else WARNING

    def is_worth(self, lens: Camera) -> bool:
        """Whether points in the pictures move enough for it, and surely."""
        focal = float(np.sqrt(lens.fx * lens.fy))
        border = 0.5 * max(lens.image_size) / focal
        unit = focal if self.part in ("fx", "fy", "cx", "cy") else 1.0
        unit = border**-3 if self.part == "k1" else unit
        return abs(self.value) > _NOTABLE * unit and self.sigma < _VAGUE * unit


def lens_columns(problem: TreeProblem, linear: TreeLinear) -> dict[tuple[str, str], NDArray]:
    """Return derivatives by what is asked of lenses that were held. (R,) each."""
    parameters, found = problem.residuals.parameters, dict[tuple[str, str], NDArray]()
    seeing, free = {s.name for s in problem.observations.sensors}, set(problem.free_names)
    for name, lens in parameters.base.lenses.items():
        at = {part: parameters.index[f"{name}.{part}"] for part in NUMBERS}
        if name not in seeing or {f"{name}.{part}" for part in _TOGETHER[SIZE]} & free:
            continue
        found |= {(name, part): linear.J[row] for part, row in at.items()}
        for part, numbers in _TOGETHER.items():
            sizes = np.array([getattr(lens, one) for one in numbers])
            found[name, part] = sizes @ linear.J[[at[one] for one in numbers]]
    return found


def wrong_parts(
    columns: dict[tuple[str, str], NDArray], Z: NDArray, z: NDArray, redundancy: int
) -> tuple[LensPart, ...]:
    """Return the numbers that a recording contradicts, those first that explain most.

    Args:
        columns: See `lens_columns`.
        Z: The same, whitened, what was free taken off. Shape (n, m).
        z: What is left at the solution. Shape (n,).
        redundancy: Of the solution.
    """
    scalars = [int(np.count_nonzero(columns[camera, FOCAL])) for camera, _ in columns]
    first, asked, missed, chosen = np.linalg.norm(Z, axis=0), Z, z, list[int]()
    focal = np.array([part == FOCAL for _, part in columns])
    found, doubted = list[LensPart](), False
    while columns and len(found) <= _MOST and not doubted:
        size, squares = np.linalg.norm(Z, axis=0), float(z @ z)
        told = size > np.maximum(TOLD * first, np.finfo(float).tiny)
        size = np.where(told, size, np.inf)
        along = Z.T @ z / size
        left = np.maximum(squares - along**2, np.finfo(float).tiny)
        gain = redundancy * along**2 / max(squares, np.finfo(float).tiny)
        best = int(np.argmin(left))
        if len(columns) * chi_square_tail(float(gain[best]), 1) > CHANCE:
            best = int(np.argmin(np.where(focal, left, np.inf)))
            doubted = int(focal.sum()) * chi_square_tail(float(gain[best]), 1) < DOUBTED
            if found or not doubted:
                break
        as_good = told & (redundancy * np.log(left / left[best]) < 2.0 * np.log(_ODDS))
        value, sigma = -along / size, np.sqrt(left / redundancy) / size
        parts = {
            k: LensPart(*key, float(gain[k]), float(value[k]), float(sigma[k]), scalars[k])
            for k, key in enumerate(columns)
            if as_good[k]
        }
        found.append(replace(parts.pop(best), others=tuple(parts.values()), doubted=doubted))
        chosen.append(best)
        unit = Z[:, best] / size[best]
        z, Z = z - unit * along[best], Z - np.outer(unit, unit @ Z)
    values = np.linalg.lstsq(asked[:, chosen], -missed, rcond=None)[0].tolist()
    return tuple(replace(one, value=value) for one, value in zip(found, values, strict=True))


def lens_findings(
    parts: Sequence[LensPart], lenses: Mapping[str, Camera], least: float
) -> list[Finding]:
    """Say in one sentence which numbers of lenses what was seen contradicts.

    Args:
        parts: See `wrong_parts`.
        lenses: As they were told.
        least: What all of them must explain [scalars].
    """
    parts = [one for one in parts if one.is_worth(lenses[one.camera])]
    if not parts or sum(one.gain for one in parts) < least:
        return []
    wishes = [" or ".join(_wish(p, lenses[p.camera]) for p in (one, *one.others)) for one in parts]
    unsure = any(one.others for one in parts)
    names = dict.fromkeys(name for one in parts for name in one.parts)
    freed = " ".join(f"--free {name}" for name in names)
    bent = any(one.part == "k1" for one in parts)
    cause = "a lens told without its distortion, or with another's" if bent else "correct it"
    if len(parts) > _MOST or (len(parts) > 1 and not bent):
        cause = _SEVERAL
    text = (
        f"lenses contradict what was seen ({listed(wishes)}"
        f"{'; which of them, it does not tell' if unsure else ''}): {cause}; `{freed}` learns "
        f"{'it' if len(parts) == 1 else 'them'}"
    )
    severity = CAUSE if any(one.severity == CAUSE for one in parts) else WARNING
    return [Finding(severity, text)]


def _wish(part: LensPart, lens: Camera) -> str:
    """Say where a number of a lens would go."""
    name, factor = part.camera, float(np.exp(part.value))
    if part.part == SIZE:
        return f"pictures of {name} as of a lens {factor:.4g} times as long"
    if part.part == FOCAL:
        both = f"{factor * lens.fx:.0f} and {factor * lens.fy:.0f}"
        return f"{name}.fx and {name}.fy {lens.fx:.0f} and {lens.fy:.0f} px would go to {both}"
    now = float(getattr(lens, part.part))
    if part.part == "k1":
        return f"{name}.k1 {now:.3g} would go to {now + part.value:.3g}"
    return f"{name}.{part.part} {now:.0f} px would go to {now + part.value:.0f}"
