"""What tests of all folders share."""

import os
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import pytest
from flaky_tests import is_whole_suite, mark_flaky_tests
from hypothesis import HealthCheck, settings
from marked_files import MISREAD, find_misread, is_left_out

from gslcosim.environment.geometry_source import build_still_environment
from gslcosim.environment.model import Box, Cell, Environment, Grid, WindFrames
from gslcosim.scenario import load_scenario
from gslcosim.scenario.models.scenario import Scenario

# The same examples every time: a law that fails must fail for everyone, and a slow machine is no failure.
# `HYPOTHESIS_PROFILE=explore` looks for new examples.
settings.register_profile(
    "repeatable", deadline=None, derandomize=True, database=None, suppress_health_check=[HealthCheck.too_slow]
)
settings.register_profile("explore", deadline=None, database=None, suppress_health_check=[HealthCheck.too_slow])
settings.load_profile(os.environ.get("HYPOTHESIS_PROFILE", "repeatable"))

GOLDEN_DIR = Path(__file__).parent / "tests" / "golden"
MARKS = ("slow", "end_to_end", "tour", "debian", "extras", "soak")
# A module's tests go to one worker. The longest modules begin first: begun last, one would run while no other does.
LONGEST_MODULES = (
    "test_core_alone", "test_ray_pool", "test_two_hosts", "test_sandboxes", "test_tutorials", "test_method_ports",
    "test_fork",
    "test_new_agents", "test_snapshots", "test_readme", "test_live", "test_machine_faults", "test_languages",
    "test_runner", "test_hostile_submissions", "test_get_started", "test_faults", "test_gateway",
    "test_transport_pages", "test_compose_run", "test_openfoam", "test_submission", "test_events", "test_methods",
    # Of those that start no processes.
    "test_foreign_folders", "test_wind_cases", "test_gas_pages", "test_pimplefoam", "test_extend_sensor",
    "test_reference_free_kernels", "test_heated_cavity", "test_docs_site", "test_reference_cases", "test_plots",
    "test_batch_equals_flight", "test_bundled_suites", "test_training", "test_exchange_fuzz",
)  # fmt: skip


def pytest_ignore_collect(collection_path: Path, config: pytest.Config) -> bool | None:
    """Pass over files that a mark leaves out, where the whole suite is collected."""
    return True if is_whole_suite(config) and is_left_out(collection_path, config) else None


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Give a second try to who is named for it; before tests are left out, so that no name is missed."""
    mark_flaky_tests(config, items, Path(__file__).parent / "tests" / "flaky_tests.yaml")
    config.stash[MISREAD] = find_misread(items, MARKS)
    ranks = {name: rank for rank, name in enumerate(LONGEST_MODULES)}
    items.sort(key=lambda item: ranks.get(item.path.stem, len(ranks)))


@pytest.fixture(scope="session", autouse=True)
def _state_folder(tmp_path_factory: pytest.TempPathFactory):
    """What tests find out is not kept in the state of who runs them."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("GSLCOSIM_STATE", str(tmp_path_factory.mktemp("state")))
        yield


@pytest.fixture
def golden() -> Callable[[str, str], None]:
    """Compare a text with the file of that name in tests/golden; `make golden` rewrites the files instead."""

    def check(name: str, text: str) -> None:
        path = GOLDEN_DIR / name
        if os.environ.get("GSLCOSIM_REWRITE_GOLDEN"):
            path.write_text(text, encoding="utf-8")
        assert text == path.read_text(encoding="utf-8"), f"{path} differs: `make golden` rewrites it, review the diff"

    return check


@pytest.fixture
def make_room() -> Callable[..., Environment]:
    """Build a closed room of 15 x 10 x 6 m with uniform wind (one velocity a frame) and named obstacles."""

    def build(*, wind_m_s=((0.0, 0.0, 0.0),), obstacles=(), period_s=1.0, is_looping=True) -> Environment:
        grid = Grid(origin_m=(0.0, 0.0, 0.0), cell_m=0.25, shape=(60, 40, 24))
        x_m, y_m, z_m = grid.max_m
        wall = 0.2
        boxes = [
            Box(name="floor", kind="floor", min_m=(-wall, -wall, -wall), max_m=(x_m + wall, y_m + wall, 0.0)),
            Box(name="ceiling", kind="ceiling", min_m=(-wall, -wall, z_m), max_m=(x_m + wall, y_m + wall, z_m + wall)),
            Box(name="wall_west", kind="wall", min_m=(-wall, -wall, 0.0), max_m=(0.0, y_m + wall, z_m)),
            Box(name="wall_east", kind="wall", min_m=(x_m, -wall, 0.0), max_m=(x_m + wall, y_m + wall, z_m)),
            Box(name="wall_south", kind="wall", min_m=(0.0, -wall, 0.0), max_m=(x_m, 0.0, z_m)),
            Box(name="wall_north", kind="wall", min_m=(0.0, y_m, 0.0), max_m=(x_m, y_m + wall, z_m)),
        ]
        occupancy = np.zeros(grid.shape, np.uint8)
        for name, min_m, max_m in obstacles:
            boxes.append(Box(name=name, kind="obstacle", min_m=min_m, max_m=max_m))
            low, high = grid.cell_of(np.array(min_m) + 1e-9), grid.cell_of(np.array(max_m) - 1e-9) + 1
            occupancy[tuple(slice(a, b) for a, b in zip(low, high, strict=True))] = Cell.SOLID
        velocity_m_s = np.empty((len(wind_m_s), *grid.shape, 3), np.float32)
        velocity_m_s[:] = np.array(wind_m_s, np.float32)[:, None, None, None, :]
        return Environment(
            name="room",
            grid=grid,
            occupancy=occupancy,
            wind=WindFrames(velocity_m_s=velocity_m_s, period_s=period_s, is_looping=is_looping),
            boxes=tuple(boxes),
            openings=(),
            content_hash="room",
        )

    return build


@pytest.fixture
def make_scenario() -> Callable[..., Scenario]:
    """Build a scenario of one agent, or one for each of the given changes to that agent's vehicle."""

    def build(*vehicles, mode="on_request", tick_ms=100) -> Scenario:
        return Scenario.model_validate(
            {
                "schema": "gslcosim/scenario/1",
                "name": "test",
                "tick_ms": tick_ms,
                "environment": {"layout": {}},
                "gas": {"sources": [{"position_m": (5.0, 1.0, 2.0)}]},
                "agents": [
                    {
                        "name": f"agent_{i}",
                        "start": {"python": "dung_beetle"},
                        "mode": mode,
                        "vehicle": {"start_m": (3.0 + 2.0 * i, 3.0, 0.2), "hold_s": 0.5, **vehicle},
                        "sensors": [{"model": "tgs2600", "name": "nose"}],
                    }
                    for i, vehicle in enumerate(vehicles or ({},))
                ],
            }
        )

    return build


@pytest.fixture
def room_with_gate() -> Callable[..., tuple[Scenario, Environment]]:
    """Return a function that makes `event_door` with given events, and its rooms in still air, as cores know them."""

    def build(*events: str, changes: Sequence[str] = ()) -> tuple[Scenario, Environment]:
        overrides = [f"events=[{', '.join(events)}]", *changes]
        loaded = load_scenario("event_door", overrides=overrides)
        return loaded.scenario, build_still_environment(loaded.scenario, scenario_dir=loaded.directory)

    return build
