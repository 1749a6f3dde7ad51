"""The open comparison of 2027: one thing changed at a time, a dense gas that sinks, pages that state its size."""

from collections import Counter
from itertools import combinations
from pathlib import Path

import numpy as np
import pytest

from gslcosim.environment.generation.cache import prepare_environment
from gslcosim.environment.store import load_environment
from gslcosim.scenario import Scenario
from gslcosim_bench.cases import load_suite
from gslcosim_bench.cases.models import LABELS, Case, select_labels
from gslcosim_bench.cases.plan import build_plan, expand_cases
from gslcosim_bench.statistics.rates import wilson
from gslcosim_services.fields.gas_builder import build_gas_field

ROOT = Path(__file__).parents[5]
SUITE = load_suite("open_2027")
SOURCE_M = (3.0, 7.0, 1.5)
# How far downwind of the source plumes are compared [m], and by how much a dense one has to be lower there [m].
DOWNWIND_M, LEAST_DROP_M = 5.0, 0.5


def all_cases() -> list[Case]:
    return [case for _, case in expand_cases(SUITE)]


def labels_apart(case: Case, core: Case) -> list[str]:
    labels = select_labels(case.varied)
    return [axis for axis, level in labels.items() if level != core.varied[axis]]


def test_it_changes_one_thing_at_a_time_or_in_balance() -> None:
    cases = {case.scenario: case for case in all_cases()}
    core = cases["core"]
    mixed = [case for case in cases.values() if case.family == "mixed"]
    for case in cases.values():
        if case.family in ("core", "mixed"):
            continue
        expected = {f"{LABELS}{case.family}"} | ({f"{LABELS}room"} if case.family == "grant" else set())
        assert set(labels_apart(case, core)) == expected, case.name
    airs = [
        tuple(value for value in case.overrides if value.startswith(("environment.", "wind.")))
        for case in cases.values()
        if case.source.name == "core.yaml"
    ]
    assert len(set(airs)) == len(airs), "open scenarios share a room"
    axes = [axis for axis in core.varied if len({case.varied[axis] for case in mixed}) > 1]
    assert len(axes) == 7
    for one, other in combinations(axes, 2):
        pairs = Counter((case.varied[one], case.varied[other]) for case in mixed)
        assert set(pairs.values()) == {2}, (one, other)


def test_its_pages_state_its_size() -> None:
    text = (ROOT / "docs" / "benchmark" / "open_2027.md").read_text()
    cases = all_cases()
    n_pairs, n_controls = sum(case.repetitions for case in cases), sum(case.n_controls for case in cases)
    assert f"**{n_pairs} pairs**" in text
    assert f"{n_controls} controls" in text
    assert f"{100 * wilson(0, n_controls).high:.1f} %" in text
    for axis in SUITE.suite.set:
        assert f"| `{axis.removeprefix(LABELS)}` |" in text
    for case in cases:
        assert f"| `{case.scenario}` |" in text, "the table of the pilot has each scenario"


def test_all_leaks_are_small_and_all_air_has_eddies() -> None:
    plan = build_plan(SUITE, wants=lambda slot: slot.repetition == 0 and slot.entry == "sweep_largest")
    for trial in plan.trials:
        gas = trial.resolved.gas
        assert all(source.sigma_m <= 0.1 for source in gas.sources), trial.case
        if gas.model == "filament":
            assert gas.turbulence is not None, trial.case
            assert gas.turbulence.kind in ("given", "wind"), trial.case
    heights_m = {t.scenario: t.resolved.gas.sources[0].position_m[2] for t in plan.trials}
    assert (heights_m["core"], heights_m["height_low"], heights_m["height_high"]) == (1.5, 0.3, 2.8)
    assert {gas.gas for gas in plan_of("source_decoy").gas.sources} == {None, "propanol"}


def plan_of(scenario: str) -> Scenario:
    """A scenario as its first repetition flies it."""
    plan = build_plan(
        SUITE,
        wants=lambda slot: (slot.scenario, slot.repetition, slot.entry) == (scenario, 0, "sweep_largest"),
    )
    return next(trial.resolved for trial in plan.trials if trial.scenario == scenario)


def mean_height_m(scenario: Scenario) -> float:
    """Return the mean height of the gas in a slice 5 m downwind of one leak at the nose's height, over 400 s."""
    source = scenario.gas.sources[0].model_copy(update={"position_m": SOURCE_M})
    gas = scenario.gas.model_copy(update={"sources": (source,)})
    wind = scenario.wind.model_copy(update={"inlet_velocity_m_s": (0.5, 0.0, 0.0)})
    still = scenario.model_copy(update={"gas": gas, "wind": wind})
    field = build_gas_field(still, load_environment(prepare_environment(still)))
    field.reset(7)
    field.advance(300)
    heights_m: list[np.ndarray] = []
    for _ in range(400):
        field.advance(5)
        place_m = field.filaments.position_world_m
        heights_m.append(place_m[np.abs(place_m[:, 0] - SOURCE_M[0] - DOWNWIND_M) < 0.25, 2])
    return float(np.concatenate(heights_m).mean())


@pytest.mark.slow
def test_a_dense_gas_sinks_and_a_light_one_rises_on_the_way_to_the_nose() -> None:
    neutral_m, dense_m, light_m = (mean_height_m(plan_of(name)) for name in ("core", "gas_dense", "gas_light"))
    assert neutral_m == pytest.approx(SOURCE_M[2], abs=0.1)
    assert dense_m < neutral_m - LEAST_DROP_M
    assert light_m > neutral_m + LEAST_DROP_M
