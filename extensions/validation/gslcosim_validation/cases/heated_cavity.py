"""Natural convection in a square cavity between a hot and a cold wall, beside published figures (de Vahl Davis)."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gslcosim.flow.buoyancy import Buoyancy, BuoyantScalar, Surface
from gslcosim.flow.domain import build_domain
from gslcosim.flow.patches import SlipWall
from gslcosim.flow.pressure import LOW
from gslcosim.flow.solver import FlowSolver
from gslcosim.flow.turbulence import Laminar
from gslcosim_validation.results import Effort, Figure, Findings, Progress, plain_estimate

PRANDTL = 0.71
# Cells along the side: at least six in the layer at the heated wall, which is about 1 / Nu of it.
CELLS = {"quick": {"1e3": 16, "1e4": 32}, "full": {"1e3": 24, "1e4": 32, "1e5": 64, "1e6": 112}}
# Turnovers, side over (g' ds side)^(1/2), after which the flow no longer changes in the third digit.
TURNOVERS = {"1e3": 20.0, "1e4": 40.0, "1e5": 60.0, "1e6": 100.0}


@dataclass(frozen=True, kw_only=True)
class CavityFlow:
    """Steady flow of a cavity of side 1.

    `nusselt_hot`, `nusselt_cold`: heat through each wall over that of still air; `u_max`, `w_max`: largest velocities
    on the midlines times side over thermal diffusivity; `warmth` (n, n) over x and z, from -0.5 to 0.5; `wind_m_s`
    (n, n, 2) its x- and z-components.
    """

    nusselt_hot: float
    nusselt_cold: float
    u_max: float
    w_max: float
    warmth: NDArray[np.float32]
    wind_m_s: NDArray[np.float32]


def solve_heated_cavity(rayleigh: float, n_cells: int, turnovers: float) -> CavityFlow:
    """Solve the laminar flow between a hot wall at x = 0 and a cold one at x = 1, floor and ceiling insulated.

    Args:
        rayleigh: Rayleigh number g' ds side^3 / (nu D).
        n_cells: Along the side.
        turnovers: How long, in units of side over (g' ds side)^(1/2).
    """
    cell_m = 1 / n_cells
    nu_m2_s = (PRANDTL / rayleigh) ** 0.5
    diffusivity_m2_s = nu_m2_s / PRANDTL
    sides = [SlipWall(min_m=(0, y, 0), max_m=(1, y, 1)) for y in (0.0, cell_m)]
    domain = build_domain(np.ones((n_cells, 1, n_cells), bool), cell_m, sides, needs_openings=False)
    surfaces = [Surface(min_m=(x, 0, 0), max_m=(x, cell_m, 1), value=value) for x, value in ((0.0, 0.5), (1.0, -0.5))]
    heat = BuoyantScalar(buoyancy_m_s2=1.0, diffusivity_m2_s=diffusivity_m2_s, surfaces=surfaces)
    solver = FlowSolver(domain, Laminar(domain, nu_m2_s), buoyancy=(buoyancy := Buoyancy(domain, heat)))
    while solver.time_s < turnovers:
        solver.step(until_s=turnovers)
    inner = slice(LOW, LOW + n_cells)
    warmth = buoyancy.values[inner, LOW, inner].copy()
    middle = LOW + n_cells // 2
    return CavityFlow(
        nusselt_hot=float(np.mean((0.5 - warmth[0]) * 2 * n_cells)),
        nusselt_cold=float(np.mean((warmth[-1] + 0.5) * 2 * n_cells)),
        u_max=float(solver.velocity[0][middle, LOW, inner].max() / diffusivity_m2_s),
        w_max=float(solver.velocity[2][inner, LOW, middle].max() / diffusivity_m2_s),
        warmth=warmth,
        wind_m_s=solver.centre_velocity()[:, 0][..., [0, 2]],
    )


def measure(published: Mapping[str, Any], effort: Effort, progress: Progress) -> Findings:
    """Return heat and velocities at each published Rayleigh number."""
    figures: list[Figure] = []
    flows: dict[str, CavityFlow] = {}
    for i, (rayleigh, n_cells) in enumerate(CELLS[effort].items()):
        progress(f"Rayleigh number {rayleigh}", i / len(CELLS[effort]))
        flow = flows[rayleigh] = solve_heated_cavity(float(rayleigh), n_cells, TURNOVERS[rayleigh])
        for name, value in (("nu_mean", flow.nusselt_hot), ("u_max", flow.u_max), ("w_max", flow.w_max)):
            words = {"rayleigh": rayleigh, "n_cells": n_cells, "known": published[rayleigh][name]}
            figures.append(Figure(name, plain_estimate(value), **words))
    return Findings(figures=figures, drawings={"flow": lambda figure: _draw(figure, flows)})


def _draw(figure: Any, flows: Mapping[str, CavityFlow]) -> None:
    axes = figure.subplots(1, len(flows), squeeze=False)[0]
    for each, (rayleigh, flow) in zip(axes, flows.items(), strict=True):
        at = (np.arange(flow.warmth.shape[0]) + 0.5) / flow.warmth.shape[0]
        each.contourf(at, at, flow.warmth.T, levels=np.linspace(-0.5, 0.5, 11), cmap="coolwarm")
        step = max(1, at.size // 12)
        u, w = np.moveaxis(flow.wind_m_s[::step, ::step], -1, 0)
        each.quiver(at[::step], at[::step], u.T, w.T)
        each.set(title=f"Ra = {rayleigh}", xlabel="x / side", aspect="equal")
    axes[0].set_ylabel("z / side")
