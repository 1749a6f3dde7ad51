"""Racks as in the thesis: rows and aisles from the room's size, loads by lot, items clear of each other."""

import math
from itertools import combinations

import pytest

from gslcosim.environment.layouts.families import (
    LOADS,
    N_TYPES,
    bounding_area,
    build_items,
    build_racks,
    rack_areas,
    rack_types,
)
from gslcosim.environment.layouts.layouts import opening_specs
from gslcosim.scenario.models.geometry import ComplexWarehouseSpec, SimpleWarehouseSpec


def areas_of(layout):
    return dict(rack_areas(layout, opening_specs(layout)))


def test_the_thesis_warehouse_has_four_rows_of_two_racks():
    areas = areas_of(SimpleWarehouseSpec())
    assert len(areas) == 8
    assert sorted({round(area.min_m[0], 3) for area in areas.values()}) == [0.0, 4.667, 9.333, 14.0]
    assert {(area.min_m[1], area.max_m[1]) for area in areas.values()} == {(3.5, 7.5), (7.5, 11.5)}


def test_inner_rows_are_turned_in_a_complex_warehouse():
    areas = areas_of(ComplexWarehouseSpec())
    turned = {name: area for name, area in areas.items() if name.startswith("turned")}
    assert len(turned) == 4
    assert all(area.size_m == pytest.approx((4.0, 1.0)) for area in turned.values())
    assert all(areas[name].size_m == pytest.approx((1.0, 4.0)) for name in areas if name not in turned)


@pytest.mark.parametrize("size_m", [(15.0, 15.0, 8.0), (10.0, 16.0, 8.0), (20.0, 30.0, 8.0), (31.0, 12.0, 4.0)])
@pytest.mark.parametrize("spec", [SimpleWarehouseSpec, ComplexWarehouseSpec])
def test_racks_leave_the_aisles(spec, size_m):
    layout = spec(size_m=size_m)
    areas = areas_of(layout)
    for (name, a), (other, b) in combinations(areas.items(), 2):
        assert a.is_apart_from(b), (name, other)
        if name.rpartition("_")[0] != other.rpartition("_")[0] and "turned" not in name + other:
            assert a.is_apart_from(b, layout.rack_aisle_m)
    for area in areas.values():
        assert area.min_m[1] >= 3.5 - 1e-9
        assert area.max_m[1] <= size_m[1] - 3.5 + 1e-9


@pytest.mark.parametrize("seed", range(1, 10))
@pytest.mark.parametrize("share", [0.0, 0.2, 0.85, 1.0])
def test_at_least_the_share_asked_for_is_filled(seed, share):
    types = rack_types(SimpleWarehouseSpec(seed=seed, filled_least_frac=share), 16)
    assert sum(each < len(LOADS) for each in types) >= math.ceil(share * 16)


def test_all_nine_types_occur():
    drawn = {each for seed in range(20) for each in rack_types(SimpleWarehouseSpec(seed=seed), 16)}
    assert drawn == set(range(N_TYPES))
    assert len(LOADS) == 7


def test_racks_stand_on_each_other_up_to_the_ceiling():
    layout = SimpleWarehouseSpec()
    boxes = build_racks(layout, opening_specs(layout))
    assert max(box.max_m[2] for box in boxes) == 6.0
    assert sum(box.name.endswith("_post_0") for box in boxes) == 16


def test_items_keep_apart_and_leave_the_openings_clear():
    layout = ComplexWarehouseSpec(seed=3)
    openings = opening_specs(layout)
    boxes = build_items(layout, openings)
    kinds = {"_".join(box.name.split("_")[:2]) for box in boxes}
    assert kinds == {"forklift_0", *(f"pile_{i}" for i in range(5)), *(f"pallet_{i}" for i in range(3))}
    bounds = {
        kind: bounding_area([c[:2] for box in boxes if box.name.startswith(f"{kind}_") for c in (box.min_m, box.max_m)])
        for kind in kinds
    }
    for a, b in combinations(bounds.values(), 2):
        assert a.is_apart_from(b, 0.5)
    for area in bounds.values():
        assert area.min_m[0] >= 1.5 or area.min_m[1] >= 1.5
        assert area.max_m[0] <= 13.5 or area.max_m[1] <= 13.5
