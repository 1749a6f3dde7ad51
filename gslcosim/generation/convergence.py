"""How a value converges with the cells of a mesh: observed order, and what it would be without cells."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

# A safety factor of three or more meshes, Roache 1994.
SAFETY = 1.25
MAX_ORDER = 20.0


@dataclass(frozen=True, kw_only=True)
class Convergence:
    """How three values on finer and finer meshes converge.

    `kind` is `monotone`, `oscillating`, or `none` where the finer change is not the smaller one.
    `order` is the observed order of accuracy; `extrapolated` the value that an infinitely fine mesh would give;
    `uncertainty_frac` the grid convergence index of the finest mesh, relative to its value. The three are absent
    where there is no convergence, the last two also where values oscillate.
    """

    kind: str
    order: float | None = None
    extrapolated: float | None = None
    uncertainty_frac: float | None = None


def convergence_of(cells_m: Sequence[float], values: Sequence[float]) -> Convergence:
    """Return the convergence of the values on the three finest meshes.

    |e32 / e21| = r21^p (r32^p - 1) / (r21^p - 1)         p the order
    extrapolated = (r21^p f1 - f2) / (r21^p - 1)
    uncertainty = 1.25 |(f1 - f2) / f1| / (r21^p - 1)

    f1 is the value on the finest mesh, e21 = f2 - f1, r21 = h2 / h1: all ratios are without dimension.

    Args:
        cells_m: Three or more edges of cells [m], any order.
        values: What each mesh gives, any unit.

    Source:
        Roache 1994, doi:10.1115/1.2910291; Celik and others 2008, doi:10.1115/1.2960953.
    Deviation:
        The equation for p is solved by bisection: the fixed-point iteration of the latter does not always end.
    Held by:
        tests/unit/generation/test_convergence.py
    """
    meshes = sorted(zip(cells_m, values, strict=True))[:3]
    if len(meshes) < 3:
        return Convergence(kind="none")
    (h1, f1), (h2, f2), (h3, f3) = meshes
    e21, e32 = f2 - f1, f3 - f2
    if e21 == 0.0 or e32 == 0.0:
        return Convergence(kind="none")
    kind = "monotone" if e32 / e21 > 0 else "oscillating"
    order = _order(h2 / h1, h3 / h2, abs(e32 / e21))
    if order is None:
        return Convergence(kind="none")
    if kind == "oscillating":
        return Convergence(kind=kind, order=order)
    growth = (h2 / h1) ** order
    return Convergence(
        kind=kind,
        order=order,
        extrapolated=(growth * f1 - f2) / (growth - 1.0),
        uncertainty_frac=SAFETY * abs(e21 / f1) / (growth - 1.0) if f1 else None,
    )


# The right side grows with p, from ln r32 / ln r21 at p = 0: by bisection. Nothing when differences that do not shrink
# leave no order above zero.
def _order(r21: float, r32: float, ratio: float) -> float | None:
    if ratio <= math.log(r32) / math.log(r21) * (1 + 1e-9):
        return None
    low, high = 0.0, MAX_ORDER
    while high - low > 1e-12:
        middle = (low + high) / 2
        is_below = r21**middle * (r32**middle - 1.0) < ratio * (r21**middle - 1.0)
        low, high = (middle, high) if is_below else (low, middle)
    return low
