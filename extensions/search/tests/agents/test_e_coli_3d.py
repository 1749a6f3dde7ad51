import math

import numpy as np
from briefings import briefing, observation

from gslcosim.contract.messages import KnownMap
from gslcosim.contract.record import NumericArray
from gslcosim_agents.e_coli_3d.agent import EColi3d

HERE_M = (7.0, 5.0, 4.0)


def steps_m(flown: EColi3d, ohms, here_m=HERE_M):
    ends_m = [
        flown.decide(observation(tick=i, position_m=here_m, readings={"nose": ohm})).position_world_m
        for i, ohm in enumerate(ohms)
    ]
    return [tuple(np.round(np.subtract(end_m, here_m), 9)) for end_m in ends_m]


def test_a_surge_through_a_known_wall_is_drawn_again_and_one_above_it_is_not():
    """A wall 3 m high, east of the vehicle, in a map in space."""
    occupied = np.zeros((30, 20, 16), np.uint8)
    occupied[15, :, :6] = 1
    known = KnownMap(origin_m=(0.0, 0.0, 0.0), cell_m=0.5, occupied=NumericArray.from_array(occupied))
    reached_m = {height_m: [] for height_m in (1.5, 4.0)}
    for height_m, found_m in reached_m.items():
        flown = EColi3d(briefing(known_map=known))
        found_m += [7.0 + dx for dx, _, _ in steps_m(flown, [5e4] * 200, (7.0, 5.0, height_m))]
    assert max(reached_m[1.5]) <= 7.5
    assert max(reached_m[4.0]) > 7.9


def test_it_declares_in_space():
    flown = EColi3d(briefing(sensors=[("pid", "nose")]))
    around = [
        (radius_m, math.tau * i / n, ppm) for n, radius_m, ppm in ((8, 0.3, 5.0), (3, 1.2, 0.0)) for i in range(n)
    ]
    places = [((7.0 + r * math.cos(a), 5.0 + r * math.sin(a), 3.0), ppm) for r, a, ppm in [(0.0, 0.0, 6.0), *around]]
    said = [
        flown.decide(observation(tick=i, position_m=place_m, readings={"nose": ppm}))
        for i, (place_m, ppm) in enumerate(places)
    ]
    (declared,) = [command for command in said if command.kind == "declare_source"]
    assert abs(declared.declaration.position_world_m[2] - 3.0) < 1e-9
