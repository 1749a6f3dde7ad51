"""The wind that comes in over open land, and what keeps a plant open."""

import math
from itertools import pairwise

import pytest

from gslcosim.environment.layouts.layouts import build_layout
from gslcosim.scenario.models.geometry import PlantSpec
from gslcosim.scenario.models.scenario import WindSpec

PLANT = PlantSpec(size_m=(12.0, 8.0, 12.0), n_tanks=0, n_buildings=0)


def inlets_of(layout, wind):
    return [opening for opening in build_layout(layout, wind).openings if opening.kind == "inlet"]


def test_the_wind_at_the_inlet_is_that_of_the_scenario_at_the_reference_height():
    """The reference height lies at a layer's middle, so the law gives exactly the scenario's wind there."""
    layout = PLANT.model_copy(update={"reference_height_m": 9.9})
    speeds = {
        round((o.min_m[2] + o.max_m[2]) / 2, 6): o.velocity_m_s[0]
        for o in inlets_of(layout, WindSpec(cell_m=0.2, inlet_velocity_m_s=(4.0, 1.0, 0.0)))
    }
    assert speeds[9.9] == pytest.approx(4.0)
    assert list(speeds.values()) == sorted(speeds.values())


def test_the_wind_grows_with_the_logarithm_of_the_height():
    a, b, c = (inlets_of(PLANT, WindSpec(cell_m=0.2))[k].velocity_m_s[0] for k in (0, 4, 30))
    z0 = PLANT.roughness_m
    ratio = math.log((0.9 + z0) / (0.1 + z0)) / math.log((6.1 + z0) / (0.9 + z0))
    assert (b - a) / (c - b) == pytest.approx(ratio)


def test_layers_of_the_inlet_cover_its_face_once():
    inlets = inlets_of(PLANT, WindSpec(cell_m=0.25))
    assert len(inlets) == 48
    assert inlets[0].min_m == (0.0, 0.0, 0.0)
    assert inlets[-1].max_m == (0.0, 8.0, 12.0)
    assert all(a.max_m[2] == b.min_m[2] for a, b in pairwise(inlets))


def test_a_plant_is_open_on_all_sides_but_the_ground():
    kinds = {o.name: o.kind for o in build_layout(PLANT, WindSpec(cell_m=0.25)).openings if o.kind != "inlet"}
    assert kinds == {"outlet": "outlet", "open_y_min": "open", "open_y_max": "open", "open_top": "open"}
