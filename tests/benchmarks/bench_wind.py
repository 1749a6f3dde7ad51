"""How accurate and how fast the wind solver is: run with `make bench-wind`.

The solver computes in one thread, so its times are those of the processor: other work on the machine counts less.
bench_solvers.py times it beside pimpleFoam.

`--quick` leaves out the two minutes of flow for the means, the finest vortex and the largest grid.
"""

import itertools
import os
import runpy
import sys
import time
import tracemalloc
from pathlib import Path

import numpy as np

from gslcosim.flow import Inlet, Outlet, solve_wind_report
from gslcosim.flow.domain import build_domain
from gslcosim.flow.solver import FlowSolver
from gslcosim.flow.turbulence import make_model

TESTS = Path(__file__).parents[1]
ANALYTIC = TESTS / "analytic/flow"
SIZES = ((60, 60, 28), (75, 75, 40), (120, 120, 70), (180, 180, 93))


def say(text=""):
    sys.stdout.write(text + "\n")
    sys.stdout.flush()


def report_closed_forms(*, quick):
    cavity_error = runpy.run_path(str(ANALYTIC / "test_cavity.py"))["cavity_error"]
    vortex_error = runpy.run_path(str(ANALYTIC / "test_taylor_green.py"))["vortex_error"]
    profile_error = runpy.run_path(str(ANALYTIC / "test_channels.py"))["profile_error"]
    say("Lid-driven cavity: largest difference from Ghia et al. 1982, in lid speeds")
    for reynolds, n, end_time_s, allowed in ((100, 32, 12.0, 0.02), (400, 64, 30.0, 0.03), (1000, 64, 50.0, 0.05)):
        say(f"  Re {reynolds:5d}  {n}^2 cells  {cavity_error(reynolds, n, end_time_s):7.4f}   (allowed {allowed})")
    say("Taylor-Green vortex: root mean square error, and order")
    for nu_m2_s in (1e-3, 0.1):
        errors = [
            vortex_error(n, "xz", nu_m2_s=nu_m2_s, end_time_s=1.0) for n in ((8, 16, 32) if quick else (8, 16, 32, 64))
        ]
        orders = ", ".join(f"{np.log2(a / b):.2f}" for a, b in itertools.pairwise(errors))
        say(f"  nu {nu_m2_s:5g}   {', '.join(f'{e:.1e}' for e in errors)}   order {orders}")
    errors = [profile_error(n) for n in (6, 12)]
    say(f"Poiseuille: {', '.join(f'{e:.4f}' for e in errors)}   order {np.log2(errors[0] / errors[1]):.2f}")


def report_references(*, quick):
    foam = runpy.run_path(str(ANALYTIC / "test_pimplefoam.py"))
    folder = foam["REFERENCE"]
    if not folder.exists():
        say(f"no pimpleFoam data at {folder}; set GSLCOSIM_REFERENCE")
        return
    say("Against pimpleFoam's k-epsilon (empty 15 x 15 x 8 m warehouse, 75 x 75 x 40 cells)")
    cases = [("warehouse_empty_t5s", "k_epsilon", {"end_time_s": 5.0})]
    if not quick:
        mean = {"end_time_s": 120.0, "average_from_s": 60.0}
        cases += [("warehouse_empty_mean_60s_120s", model, mean) for model in ("k_epsilon", "smagorinsky")]
    for name, model, times in cases:
        with np.load(folder / f"{name}.npz") as data:
            theirs, free, cell_m = data["velocity_m_s"], data["free"], float(data["cell_size_m"])
        start = time.process_time()
        report = solve_wind_report(free, cell_m, foam["PATCHES"], turbulence=model, **times)
        duration_s = time.process_time() - start
        correlation, difference = foam["agreement"](report.velocity_m_s, theirs, free)
        say(
            f"  {name:30s} {model:12s} correlation {correlation:.4f}  rms difference {difference:.3f}  "
            f"{duration_s:6.2f} s  {report.n_steps} steps  divergence {report.divergence_relative:.1e}  "
            f"mass {report.mass_balance_relative:.1e}"
        )


def report_cost(*, quick):
    say("Cost by size (k-epsilon)")
    say("     cells   ns/cell/step   iterations   bytes/cell")
    # What is loaded with the first step is not the first size's.
    step_costs((15, 15, 7), n_steps=2)
    costs = []
    for shape in SIZES[:-1] if quick else SIZES:
        ns, iterations, n_bytes = step_costs(shape, n_steps=20)
        costs.append(ns)
        say(f"{np.prod(shape):10,d}   {ns:12.0f}   {iterations:10.1f}   {n_bytes:10.0f}")
    say(f"  dearest over cheapest: {max(costs) / min(costs):.2f}")


# Median time of a step over cells [ns], mean number of pressure iterations, and most memory over cells.
def step_costs(shape, *, n_steps):
    cell_m, n = 15.0 / shape[0], int(np.prod(shape))
    x_m, y_m, _ = (n_side * cell_m for n_side in shape)
    inlet = Inlet(min_m=(0, 0, 0), max_m=(0, 1.6, 2.4), velocity_m_s=(1, 0, 0))
    outlet = Outlet(min_m=(x_m, y_m - 1.6, 0), max_m=(x_m, y_m, 2.4))
    tracemalloc.start()
    domain = build_domain(np.ones(shape, bool), cell_m, [inlet, outlet])
    solver = FlowSolver(domain, make_model("k_epsilon", domain, 1.5e-5))
    solver.step(until_s=5.0)
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    durations_s, iterations = [], []
    for _ in range(n_steps):
        start = time.process_time()
        iterations.append(solver.step(until_s=5.0).pressure.iterations)
        durations_s.append(time.process_time() - start)
    return np.median(durations_s) / n * 1e9, np.mean(iterations), peak / n


def main():
    quick = "--quick" in sys.argv
    say(f"{os.cpu_count()} cores")
    report_closed_forms(quick=quick)
    report_references(quick=quick)
    report_cost(quick=quick)


if __name__ == "__main__":
    main()
