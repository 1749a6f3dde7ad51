"""How near an edited wind is to a full solve, and at what cost: run with `make bench-edits`.

Rooms with a settled wind get a door, a box or a fan. Each column is a root mean square difference from the full solve
of the edited room, over the air and over U0, the largest speed at the inlets; costs are processor time over that of the
full solve. Columns: the wind before; the solver's steps alone; an edit of the same time; one of four times that; a
solve as long as the full one that starts from the wind before, which shows how unique the settled wind is; and the
divergences of the full solve and of the edit.

Name rooms to compute only those. `--quick` solves for 0.4 of the time, and leaves out the second start.
"""

import sys
import time
from dataclasses import dataclass, field, replace
from functools import partial

import numpy as np

from gslcosim.environment.geometry_source import build_geometry
from gslcosim.environment.variants import fill_still_air
from gslcosim.flow.solve import AIR_NU_M2_S, SolverNumerics
from gslcosim.scenario.models.scenario import EnvironmentSpec
from gslcosim_formats.edited_wind import (
    COURANT,
    EditedWindSpec,
    SettledFlow,
    adapt_flow,
    build_room_domain,
    prepare_edits,
    settle_flow,
)

# Times of edits over that of the full solve.
SHORT_FRAC, LONG_FRAC = 0.04, 0.16
QUICK_FRAC = 0.4
NUMERICS = SolverNumerics(turbulence="k_epsilon", nu_m2_s=AIR_NU_M2_S, courant=COURANT)


def box(name, low_m, high_m):
    return {"name": name, "min_m": low_m, "max_m": high_m}


def fan(low_m, high_m, velocity_m_s):
    return {"openings": [{**box("fan", low_m, high_m), "kind": "inlet", "velocity_m_s": velocity_m_s}]}


def crate(*corners_m):
    return {"obstacles": [box("crate", *corners_m)]}


def door(*corners_m):
    return {"doors": [box("door", *corners_m)]}


@dataclass(frozen=True, kw_only=True)
class Room:
    """A room with its edits: doors of the environment, and what its layout has besides."""

    layout: dict
    wind: dict
    settle_s: float
    edits: dict = field(default_factory=dict)

    def domain(self, edit):
        layout = dict(self.layout)
        for key in ("obstacles", "openings"):
            layout[key] = [*layout.get(key, ()), *edit.get(key, ())]
        spec = EnvironmentSpec.model_validate({"layout": layout, "doors": edit.get("doors", ())})
        block = EditedWindSpec.model_validate(self.wind)
        return build_room_domain(fill_still_air(build_geometry(spec, block)), block)


ROOMS = {
    "two chambers": Room(
        layout={
            "kind": "warehouse_empty",
            "size_m": [6, 4, 2.5],
            "inlet": {"min_m": [6, 1.5, 0.5], "max_m": [6, 2.5, 1.5]},
            "outlet": {"min_m": [0, 1, 0.5], "max_m": [0, 3, 2]},
            "obstacles": [
                box("south", [3, 0, 0], [3.25, 1.25, 2.5]),
                box("north", [3, 2.75, 0], [3.25, 4, 2.5]),
                box("lintel", [3, 1.25, 2], [3.25, 2.75, 2.5]),
            ],
        },
        wind={"inlet_velocity_m_s": [-0.4, 0, 0], "cell_m": 0.125},
        settle_s=400.0,
        edits={
            "door, half": door([3, 1.25, 0], [3.25, 2, 2]),
            "door, a third": door([3, 1.25, 0], [3.25, 1.75, 2]),
            "box in the jet": crate([4.5, 1.75, 0], [5, 2.25, 1]),
            "box beside it": crate([4.25, 2.5, 0], [5, 3.25, 1]),
            "box in a corner": crate([5.25, 0.25, 0], [5.75, 0.75, 0.5]),
            "box, far chamber": crate([1, 3.25, 0], [1.5, 3.75, 0.5]),
            "fan, far chamber": fan([1.5, 4, 1], [2, 4, 1.5], [0, -0.3, 0]),
        },
    ),
    "home": Room(
        layout={"kind": "home", "size_m": [10, 8, 2.6], "seed": 1},
        wind={"inlet_velocity_m_s": [0.5, 0, 0], "cell_m": 0.2},
        settle_s=300.0,
        edits={
            "door of a side room": door([5.2, 4.4, 0], [6.2, 4.6, 2]),
            "door behind it": door([7.4, 1.6, 0], [7.6, 2.6, 2]),
            "main door, half": door([4.6, 7, 0], [4.8, 7.6, 2]),
            "box": crate([5, 5, 0], [6, 6, 1]),
            "box, side room": crate([5, 3, 0], [5.6, 3.6, 0.8]),
            "box at a wall": crate([9.2, 5, 0], [10, 5.8, 0.8]),
            "fan": fan([6, 8, 1], [7, 8, 1.6], [0, -0.3, 0]),
        },
    ),
    "plant": Room(
        layout={"kind": "plant", "size_m": [24, 18, 8], "seed": 1},
        wind={"inlet_velocity_m_s": [2, 0, 0], "cell_m": 0.5},
        settle_s=120.0,
        edits={
            "box before tanks": crate([3, 11, 0], [4, 12, 1]),
            "box in a wake": crate([11, 9, 0], [12, 10, 1]),
            "box aside": crate([12, 2, 0], [14, 3, 1.5]),
            "container": crate([18, 13.5, 0], [21, 14.5, 2.5]),
            "fence": crate([13, 9, 0], [13.5, 13, 1.5]),
            "fan in the ground": fan([11, 3, 0], [12, 4, 0], [0, 0, 0.5]),
        },
    ),
}


def say(text=""):
    sys.stdout.write(text + "\n")
    sys.stdout.flush()


def timed(compute):
    start = time.process_time()
    result = compute()
    return result, time.process_time() - start


# The wind at the end of a solve of `settle_s`, the mean of the last tenth, from still air or from another flow.
def full_wind(room, domain, start=None):
    if start is None:
        start, rest_s = settle_flow(domain, NUMERICS, settle_s=0.6 * room.settle_s), 0.4 * room.settle_s
    else:
        rest_s = room.settle_s
    return adapt_flow(SettledFlow(own=start, coarse=None), domain, NUMERICS, edit_s=rest_s)


def report(name, room, *, quick):
    plain = room.domain({})
    own, before_s = timed(lambda: settle_flow(plain, NUMERICS, settle_s=room.settle_s))
    short, long = (
        prepare_edits(own, plain, NUMERICS, edit_s=fraction * room.settle_s) for fraction in (SHORT_FRAC, LONG_FRAC)
    )
    starts = ((SettledFlow(own=own, coarse=None), SHORT_FRAC), (short, SHORT_FRAC), (long, LONG_FRAC))
    before = adapt_flow(starts[0][0], plain, NUMERICS, edit_s=0.1 * room.settle_s)
    say(
        f"{name}: {plain.n_air:,} cells of air, U0 {plain.reference_speed_m_s:.2g} m/s, {room.settle_s:g} s of flow in "
        f"{before_s:.1f} s"
    )
    say(f"  {'edit':20s} {'before':>6s} {'steps alone':>15s} {'edited':>15s} {'longer':>15s} {'2nd start':>9s} div")
    for label, edit in room.edits.items():
        domain = room.domain(edit)
        full, full_s = timed(partial(full_wind, room, domain))
        cells = []
        for state, fraction in starts:
            adapt = partial(adapt_flow, state, domain, NUMERICS, edit_s=fraction * room.settle_s)
            wind, cost_s = timed(adapt)
            if state is short:
                edited = wind
                assert np.array_equal(adapt().velocity_m_s, wind.velocity_m_s), "an edit is the same to the bit"
            cells.append(f"{difference(wind, full, domain):6.4f} {cost_s / full_s:6.1%}")
        other = None if quick else full_wind(room, domain, own)
        second = "" if other is None else f"{difference(other, full, domain):.4f}"
        say(
            f"  {label:20s} {difference(before, full, domain):6.4f} {' '.join(f'{cell:>15s}' for cell in cells)} "
            f"{second:>9s} {full.divergence_relative:.0e} {edited.divergence_relative:.0e}"
        )


def difference(wind, other, domain):
    squares = np.sum((wind.velocity_m_s - other.velocity_m_s) ** 2, dtype=np.float64)
    return np.sqrt(squares / domain.n_air) / domain.reference_speed_m_s


def main():
    quick = "--quick" in sys.argv
    wanted = [word for word in sys.argv[1:] if word != "--quick"] or list(ROOMS)
    full_wind(replace(ROOMS["plant"], settle_s=1.0), ROOMS["plant"].domain({}))  # loads the kernels
    for name in wanted:
        room = ROOMS[name]
        report(name, replace(room, settle_s=QUICK_FRAC * room.settle_s) if quick else room, quick=quick)


if __name__ == "__main__":
    main()
