"""How alike the built-in solver and pimpleFoam are, and how long each takes.

Run with `python tests/benchmarks/bench_solvers.py`. Needs OpenFOAM. Options:
    --mean        compare means from 30 to 60 s as well; takes ten times as long
    --ranks N     processes of OpenFOAM, 2 otherwise; with 1 it does not suffer from others on a busy machine
    --save DIR    keep pimpleFoam's fields after 5 s there, as in tests/analytic/flow/pimplefoam
    NAME ...      only these rooms
"""

import argparse
import runpy
import sys
from pathlib import Path

import numpy as np
from pydantic import TypeAdapter

from gslcosim.environment.layouts.layouts import build_layout
from gslcosim.environment.model import Cell
from gslcosim.flow import Inlet, Outlet
from gslcosim.scenario.models.scenario import Layout, WindSpec
from gslcosim_formats.solver_comparison import compare_solvers

ROOMS = runpy.run_path(str(Path(__file__).parents[1] / "analytic/flow/test_pimplefoam_rooms.py"))
LAYOUTS = ("warehouse_simple", "warehouse_complex", "home", "office")
SMALL = "small_room_of_small_cells"


def say(text):
    sys.stdout.write(text + "\n")
    sys.stdout.flush()


def room_of_layout(kind):
    room = build_layout(TypeAdapter(Layout).validate_python({"kind": kind, "seed": 1}), WindSpec())
    patches = [
        Inlet(min_m=o.min_m, max_m=o.max_m, velocity_m_s=o.velocity_m_s)
        if o.kind == "inlet"
        else Outlet(min_m=o.min_m, max_m=o.max_m)
        for o in room.openings
    ]
    return room.occupancy != Cell.SOLID, room.grid.cell_m, patches


def small_room():
    free = np.ones((60, 50, 30), bool)
    free[25:35, 15:30, :8] = False
    inlet = Inlet(min_m=(0, 0.5, 1.8), max_m=(0, 1.3, 2.4), velocity_m_s=(1, 0, 0))
    return free, 0.1, [inlet, Outlet(min_m=(2, 5, 0), max_m=(3, 5, 2))]


def room_of(name):
    if name in ROOMS["ROOMS"]:
        room = ROOMS["ROOMS"][name]
        return room.free(), room.cell_m, room.patches
    return small_room() if name == SMALL else room_of_layout(name)


def save(folder, name, velocity_m_s):
    folder.mkdir(parents=True, exist_ok=True)
    np.savez_compressed(folder / f"{name}.npz", velocity_mm_s=np.rint(velocity_m_s * 1e3).astype(np.int16))


def report(name, times, options):
    free, cell_m, patches = room_of(name)
    found = compare_solvers(free, cell_m, patches, **times, nu_m2_s=ROOMS["NU_M2_S"], n_ranks=options.ranks)
    from_s = times.get("average_from_s")
    when = f"{times['end_time_s']:.0f} s" if from_s is None else f"{from_s:.0f}-{times['end_time_s']:.0f} s"
    say(
        f"{name:26s} {int(free.sum()):8,d}  {when:>7s}  {found.agreement.correlation:11.4f}  "
        f"{found.agreement.rms_relative:9.3f}  {found.built_in_wall_s:8.1f}  {found.openfoam_wall_s:10.1f}"
    )
    if options.save and from_s is None:
        save(options.save, name, found.openfoam_m_s)


def main():
    every = (*ROOMS["ROOMS"], SMALL, *LAYOUTS)
    parser = argparse.ArgumentParser()
    parser.add_argument("names", nargs="*")
    parser.add_argument("--mean", action="store_true")
    parser.add_argument("--ranks", type=int, default=2)
    parser.add_argument("--save", type=Path)
    options = parser.parse_args()
    say("room                          cells     time  correlation  rms diff.  built-in  pimpleFoam [s]")
    for name in options.names or every:
        report(name, {"end_time_s": ROOMS["END_TIME_S"]}, options)
        if options.mean:
            report(name, {"end_time_s": 60.0, "average_from_s": 30.0}, options)


if __name__ == "__main__":
    main()
