"""How a value converges with the cells of a mesh: observed order, and what it would be without cells."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

# A safety factor of three or more meshes, Roache 1994.
SAFETY = 1.25
MAX_ITERATIONS = 200


@dataclass(frozen=True, kw_only=True)
class Convergence:
    """How three values on finer and finer meshes converge.

    `kind` is `monotone`, `oscillating`, or `none` where the finer change is not the smaller one.
    `order` is the observed order of accuracy; `extrapolated` the value that an infinitely fine mesh would give;
    `uncertainty_frac` the grid convergence index of the finest mesh, relative to its value. The three are absent
    where there is no convergence.
    """

    kind: str
    order: float | None = None
    extrapolated: float | None = None
    uncertainty_frac: float | None = None


def convergence_of(cells_m: Sequence[float], values: Sequence[float]) -> Convergence:
    """Return the convergence of the values on the three finest meshes.

    p ln r21 = ln |e32 / e21| + ln((r21^p - s) / (r32^p - s)),  s = sign(e32 / e21)
    extrapolated = (r21^p f1 - f2) / (r21^p - 1)
    uncertainty = 1.25 |(f1 - f2) / f1| / (r21^p - 1)

    f1 is the value on the finest mesh, e21 = f2 - f1, r21 = h2 / h1: all ratios are without dimension.

    Args:
        cells_m: Three or more edges of cells [m], any order.
        values: What each mesh gives, any unit.

    Source:
        Celik and others 2008, doi:10.1115/1.2960953.
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
    order = _order(h2 / h1, h3 / h2, e32 / e21)
    if order is None:
        return Convergence(kind="none")
    growth = (h2 / h1) ** order
    return Convergence(
        kind=kind,
        order=order,
        extrapolated=(growth * f1 - f2) / (growth - 1.0),
        uncertainty_frac=SAFETY * abs(e21 / f1) / (growth - 1.0) if f1 else None,
    )


# By fixed-point iteration, as the source does, but without its outer absolute value: differences that grow with finer
# cells then have no order instead of a wrong one.
def _order(r21: float, r32: float, ratio: float) -> float | None:
    sign = math.copysign(1.0, ratio)
    order = 1.0
    for _ in range(MAX_ITERATIONS):
        above, below = r21**order - sign, r32**order - sign
        if above <= 0.0 or below <= 0.0:
            return None
        previous, order = order, (math.log(abs(ratio)) + math.log(above / below)) / math.log(r21)
        if abs(order - previous) < 1e-12:
            break
    return order if order > 1e-3 else None
