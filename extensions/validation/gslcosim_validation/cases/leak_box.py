"""Leaks of helium into a box with small holes: buoyancy in the wind solver beside a rake of sensors (NIST)."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gslcosim.base.gases import GASES
from gslcosim.flow.buoyancy import Buoyancy, BuoyantScalar, Orifice, Release
from gslcosim.flow.domain import build_domain
from gslcosim.flow.pressure import HIGH, LOW
from gslcosim.flow.solve import AIR_NU_M2_S
from gslcosim.flow.solver import FlowSolver
from gslcosim.flow.turbulence import make_model
from gslcosim_bench.statistics.estimates import Estimate
from gslcosim_validation.readers.columns import MeasuredDataError
from gslcosim_validation.readers.leak_box import LeakBox, LeakCase
from gslcosim_validation.release_pairs import build_pairs
from gslcosim_validation.results import Effort, Figure, Findings, Progress, plain_estimate

# Cells along the box; with 20 in place of 12 the first leak's mean and layers change by less than 2 %.
CELLS: dict[Effort, int] = {"quick": 8, "full": 12}
# With effort quick, each of so many leaks is solved.
QUICK_EVERY = 6
# Spread of our filaments without wind, half the growth of their variance and their eddy diffusivity: the defaults.
PASSIVE_M2_S = 0.5 * 0.001 + 0.002
PASSIVE_CELLS = 4
LATER_S = 3600.0
MEAN_SHARE, LAYERS_SHARE = 0.2, 0.3
_INNER = (slice(LOW, -HIGH),) * 3


@dataclass(frozen=True, kw_only=True)
class BoxProfile:
    """Volume percent at the sensors of the rake, from below: at the end of the release, and an hour later."""

    at_end: NDArray[np.float64]
    later: NDArray[np.float64]


def solve_leak(box: LeakBox, case: LeakCase, n_cells: int, *, has_buoyancy: bool = True) -> BoxProfile:
    """Solve one leak: gas rises as a plume narrower than cells, air leaves and enters through the holes.

    Args:
        n_cells: Along the box's length.
        has_buoyancy: Otherwise the gas drives nothing and spreads as our filaments do, to the end of the release.
    """
    cell_m = box.size_m[0] / n_cells
    shape = tuple(max(1, round(side_m / cell_m)) for side_m in box.size_m)
    domain = build_domain(np.ones(shape, bool), cell_m, [], needs_openings=False)
    rate_m3_s = case.release_m3_s
    if case.leak not in box.leak_area_m2:
        known = ", ".join(box.leak_area_m2)
        raise MeasuredDataError(
            f"cases.csv, case {case.name}: expected a leak that geometry.json has ({known}), found {case.leak}."
        )
    leak = Release(
        position_m=case.position_m,
        scalar_m3_s=rate_m3_s,
        volume_m3_s=rate_m3_s,
        area_m2=box.leak_area_m2[case.leak] if has_buoyancy else None,
    )
    holes = [
        Orifice(centre_m=(0.0, hole.y_m, hole.z_m), height_m=hole.side_m, area_m2=hole.side_m**2) for hole in case.holes
    ]
    if has_buoyancy:
        gas = BuoyantScalar.of_gas(
            box.gas_density_kg_m3, GASES["helium"].diffusivity_m2_s, releases=[leak], orifices=holes
        )
    else:
        gas = BuoyantScalar(buoyancy_m_s2=0.0, diffusivity_m2_s=PASSIVE_M2_S, releases=[leak], orifices=holes)
    buoyancy = Buoyancy(domain, gas)
    model = make_model("k_epsilon" if has_buoyancy else "laminar", domain, AIR_NU_M2_S)
    solver = FlowSolver(domain, model, buoyancy=buoyancy)
    _advance(solver, case.release_s)
    at_end = _read_rake(box, buoyancy, cell_m)
    if not has_buoyancy:
        return BoxProfile(at_end=at_end, later=np.full_like(at_end, np.nan))
    buoyancy.set_releasing(is_on=False)
    _advance(solver, case.release_s + LATER_S)
    return BoxProfile(at_end=at_end, later=_read_rake(box, buoyancy, cell_m))


def _advance(solver: FlowSolver, until_s: float) -> None:
    while solver.time_s < until_s:
        solver.step(until_s=until_s)


def _read_rake(box: LeakBox, buoyancy: Buoyancy, cell_m: float) -> NDArray[np.float64]:
    values = buoyancy.values[_INNER]
    i, j = (min(int(at_m / cell_m), n - 1) for at_m, n in zip(box.rake_m[0, :2], values.shape, strict=False))
    heights_m = (np.arange(values.shape[2]) + 0.5) * cell_m
    return 100.0 * np.interp(box.rake_m[:, 2], heights_m, values[i, j])


@dataclass(frozen=True)
class _Leak:
    # One leak: the case, the solved profile, and that of gas without buoyancy.
    case: LeakCase
    ours: BoxProfile
    passive: BoxProfile

    @property
    def measured(self) -> BoxProfile:
        end_s = self.case.release_s
        return BoxProfile(at_end=self.case.profile_at(end_s), later=self.case.profile_at(end_s + LATER_S))


def measure(box: LeakBox, effort: Effort, progress: Progress) -> Findings:
    """Return how many leaks are near what was measured."""
    cases = box.cases[:: QUICK_EVERY if effort == "quick" else 1]
    leaks: list[_Leak] = []
    for i, case in enumerate(cases):
        progress(case.name, i / len(cases))
        ours = solve_leak(box, case, CELLS[effort])
        leaks.append(_Leak(case, ours, solve_leak(box, case, PASSIVE_CELLS, has_buoyancy=False)))
    late = [leak for leak in leaks if np.isfinite(leak.measured.later).all()]
    rms = float(np.sqrt(np.mean([(leak.ours.at_end - leak.measured.at_end) ** 2 for leak in leaks])))
    passive = _count(leaks, lambda x: x.at_end[-1] - x.at_end[0], LAYERS_SHARE, passive=True)
    layers = _count(leaks, lambda x: x.at_end[-1] - x.at_end[0], LAYERS_SHARE)
    return Findings(
        figures=[
            Figure("mean", _count(leaks, lambda x: x.at_end.mean(), MEAN_SHARE)),
            Figure("layers", layers, passive=f"{passive.value:.0f} of {passive.n}"),
            Figure("later", _count(late, lambda x: x.later.mean(), MEAN_SHARE)),
            Figure("rms", plain_estimate(rms, len(leaks))),
        ],
        drawings={"profiles": lambda figure: _draw(figure, box, leaks)},
        pairs=[
            pairs
            for leak in leaks
            for pairs in build_pairs("room_with_heat", leak.case.name, "mean", leak.ours.at_end, leak.measured.at_end)
        ],
    )


def _count(leaks: Sequence[_Leak], figure: Any, share: float, *, passive: bool = False) -> Estimate:
    pairs = [(figure(leak.passive if passive else leak.ours), figure(leak.measured)) for leak in leaks]
    return plain_estimate(sum(abs(ours - measured) <= share * abs(measured) for ours, measured in pairs), len(pairs))


def _draw(figure: Any, box: LeakBox, leaks: Sequence[_Leak]) -> None:
    n_columns = min(6, len(leaks))
    n_rows = -(-len(leaks) // n_columns)
    axes = figure.subplots(n_rows, n_columns, squeeze=False, sharex=True, sharey=True)
    z_m = box.rake_m[:, 2]
    for each, leak in zip(axes.ravel(), leaks, strict=False):
        each.plot(leak.measured.at_end, z_m, "o", ms=2.5, color="0.2", label="measured")
        each.plot(leak.ours.at_end, z_m, "-", lw=1.2, color="C0", label="with buoyancy")
        each.plot(leak.passive.at_end, z_m, ":", lw=1.0, color="C1", label="without")
        each.set_title(leak.case.name, fontsize=6)
    for each in axes[-1]:
        each.set_xlabel("helium [%]")
    for each in axes[:, 0]:
        each.set_ylabel("z [m]")
    axes[0, 0].legend(fontsize=5)
