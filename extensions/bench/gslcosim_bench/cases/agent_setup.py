"""Setup of an entry in a scenario: its program with robots, sensors, grants and radio, as plain scenario values."""

import math
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from gslcosim.base.bundled import find_bundled_agent
from gslcosim.base.problems import Problem
from gslcosim.environment.geometry_source import build_geometry, find_folder
from gslcosim.environment.model import EnvironmentGeometry
from gslcosim.environment.positions import can_start_at
from gslcosim.environment.store import load_environment
from gslcosim.methods.card import MethodCard, find_card_beside
from gslcosim.scenario import Scenario
from gslcosim.scenario.models.scenario import StartSpec
from gslcosim.scenario.problems import ProblemsError
from gslcosim.scenario.serialization import plain_values
from gslcosim_bench.cases.models import EntrySpec
from gslcosim_bench.cases.sensor_holds import derive_hold_s

RADIO = "radio"
# How far robots of a team stand apart at the start, and where a second nose is mounted.
TEAM_SPACING_M = 1.0
TEAM_SEPARATION_M = 0.4
NOSE_OFFSET_M = 0.25
_MOST_RINGS = 12

# A Python program in a process of its own.
_APART = {"door": "stdio"}
NO_GAS = {"kind": "scheduled", "schedule": [[0, 0]]}


def find_card(entry: EntrySpec, directory: Path) -> MethodCard | None:
    """Return the card of an entry's method, if there is one beside its program."""
    program = find_program(entry, directory)
    return find_card_beside(program) if program is not None else None


def find_program(entry: EntrySpec, directory: Path) -> Path | None:
    """Return the file of an entry's program, if it is one of Python's or stands beside the suite."""
    if entry.start.python is not None:
        beside = directory / entry.start.python
        return beside if beside.is_file() else find_bundled_agent(entry.start.python)
    return next(iter(files_in_command(entry, directory)), None)


def files_in_command(entry: EntrySpec, directory: Path) -> list[Path]:
    """Return the files that the words of an entry's command name, the program first.

    An interpreter that is named by its absolute path belongs to the machine, and is left out.
    """
    words = [word for word in entry.start.command or () if (directory / word).is_file()]
    has_interpreter = len(words) > 1 and Path(words[0]).is_absolute()
    return [directory / word for word in words[has_interpreter:]]


def apply_entry(
    scenario: Scenario,
    name: str,
    entry: EntrySpec,
    *,
    card: MethodCard | None,
    directory: Path,
    scenario_dir: Path,
    is_sandboxed: bool = False,
    has_sensor_holds: bool = False,
) -> dict[str, Any]:
    """Return the values of a scenario that an entry flies in place of the scenario's own agents.

    Args:
        scenario: Of the case; its first agent's vehicle, sensors and mode are those that entries get.
        directory: Where the entry's relative paths start.
        is_sandboxed: Whether its program has to be a process in a sandbox.
        has_sensor_holds: Whether its vehicle holds as long as its slowest gas sensor takes to respond.
    """
    values = plain_values(scenario)
    first = values["agents"][0]
    if is_sandboxed:
        first["sandbox"] = "required"
    first |= {
        "start": resolve_start(entry.start, directory).model_dump(mode="json", exclude_defaults=True)
        | (_APART if is_sandboxed and entry.start.python is not None else {}),
        "parameters": {**entry.parameters, **entry.parameters_in.get(name, {})},
        "knows": _knows(entry, card, first.get("knows") or {}),
    }
    if entry.mode is not None:
        first["mode"] = entry.mode
    # Trials are run as fast as they go, and what comes of them must not depend on the machine.
    values.pop("pace", None)
    free = [agent["name"] for agent in values["agents"][:1] if agent.get("mode") == "free"]
    if free:
        raise ProblemsError(
            [
                Problem(
                    where=f"scenarios: {name}: agents[0].mode",
                    expected="a mode that waits for the agent",
                    found="free: what comes of it depends on the clock",
                    remedy="Give the entries a mode, for example mode: on_request.",
                )
            ]
        )
    if entry.sensors is not None:
        first["sensors"] = _sensors(entry, card)
        if has_sensor_holds:
            first["vehicle"]["hold_s"] = derive_hold_s(first["sensors"])
    values["agents"] = [first, *_others(first, entry, scenario, scenario_dir)]
    if not values.get("channels") and (entry.radio or (entry.radio is None and card is not None and card.needs.radio)):
        values["channels"] = [{"name": RADIO}]
    return values


def close_sources(values: dict[str, Any]) -> None:
    """Close all sources of the gas to find in a scenario's values: what a control flies in, decoys as they are."""
    if values["gas"]["model"] == "playback":
        raise ProblemsError(
            [
                Problem(
                    where="controls",
                    expected="scenarios whose gas is computed, so that it can be left away",
                    found="model: playback",
                    remedy="Leave out controls.",
                )
            ]
        )
    sources, gas = values["gas"]["sources"], values["gas"].get("gas")
    for source in [source for source in sources if source.get("gas") in (None, gas)] or sources:
        source["release"] = NO_GAS


def resolve_start(start: StartSpec, directory: Path) -> StartSpec:
    """Return the start of a program with absolute paths for the files beside its suite."""
    if start.python is not None and (directory / start.python).is_file():
        return start.model_copy(update={"python": str((directory / start.python).resolve())})
    if start.command is None:
        return start
    words = (str((directory / word).resolve()) if _is_beside(directory, word) else word for word in start.command)
    return start.model_copy(update={"command": tuple(words)})


# A word of a command that names a file beside the suite: the program, or the script that an interpreter runs.
def _is_beside(directory: Path, word: str) -> bool:
    return ("/" in word or "." in word) and not word.startswith("-") and (directory / word).is_file()


# What a scenario grants, but not the place of its source, is granted to all beside what their methods need.
def _knows(entry: EntrySpec, card: MethodCard | None, granted: Mapping[str, Any]) -> dict[str, Any]:
    if entry.knows is not None:
        return entry.knows.model_dump(mode="json")
    needed = dict.fromkeys(card.needs.knows, True) if card is not None else {}
    return needed | {name: grant for name, grant in granted.items() if grant and name != "source"}


def _sensors(entry: EntrySpec, card: MethodCard | None) -> list[dict[str, Any]]:
    if entry.sensors != "by_method":
        return [sensor.model_dump(mode="json", exclude_none=True) for sensor in entry.sensors or ()]
    if card is None:
        raise ProblemsError(
            [
                Problem(
                    where=f"entries: {entry.name}: sensors",
                    expected="a method with a card (method.yaml beside its program) for by_method",
                    found="one without",
                    remedy="List the sensors instead.",
                )
            ]
        )
    needs = card.needs.sensors
    model = "tgs2600" if "gas_ohm" in needs else "pid"
    n_noses = max((n for kind, n in needs.items() if kind.startswith("gas")), default=1)
    sides_m = [(i - (n_noses - 1) / 2) * 2 * NOSE_OFFSET_M for i in range(n_noses)]
    noses = [
        {"model": model, "name": f"nose_{i + 1}" if n_noses > 1 else "nose", "mount_m": [0.0, -y_m, 0.0]}
        for i, y_m in enumerate(sides_m)
    ]
    wind = [{"model": "anemometer", "name": "wind"}]
    ranges = [{"model": "four_range_finders", "name": "ranges"}] if "range" in needs else []
    return [*noses, *wind, *ranges]


def _others(
    first: dict[str, Any], entry: EntrySpec, scenario: Scenario, scenario_dir: Path
) -> Iterator[dict[str, Any]]:
    if entry.robots == 1:
        return
    first["vehicle"] = {"separation_m": TEAM_SEPARATION_M, **first["vehicle"]}
    starts_m = _starts_around(scenario, entry.robots, scenario_dir)
    for i in range(1, entry.robots):
        start = {"process_of": first["name"]} if entry.start.python is not None else first["start"]
        yield {
            **first,
            "name": f"robot_{i + 1}",
            "start": start,
            "vehicle": {**first["vehicle"], "start_m": list(starts_m[i])},
        }


def build_environment(scenario: Scenario, scenario_dir: Path) -> EnvironmentGeometry:
    """Return the room of a scenario, without solving its wind."""
    spec = scenario.environment
    if spec.path is None:
        return build_geometry(spec, scenario.wind, scenario_dir=scenario_dir)
    return load_environment(find_folder(spec, scenario_dir))


# Places on rings around the first robot's, the nearest first.
def _starts_around(scenario: Scenario, n: int, scenario_dir: Path) -> list[tuple[float, float, float]]:
    vehicle, room = scenario.agents[0].vehicle, build_environment(scenario, scenario_dir)
    x_m, y_m, z_m = vehicle.start_m
    found = [vehicle.start_m]
    for ring in range(1, _MOST_RINGS):
        for k in range(6 * ring):
            angle = 2 * math.pi * k / (6 * ring)
            place_m = (
                round(x_m + ring * TEAM_SPACING_M * math.cos(angle), 3),
                round(y_m + ring * TEAM_SPACING_M * math.sin(angle), 3),
                z_m,
            )
            is_apart = all(math.dist(place_m, other_m) > 0.9 * TEAM_SPACING_M for other_m in found)
            if is_apart and can_start_at(place_m, vehicle, room):
                found.append(place_m)
            if len(found) == n:
                return found
    raise ProblemsError(
        [
            Problem(
                where="entries: robots",
                expected=f"room for {n} robots {TEAM_SPACING_M:g} m apart around {vehicle.start_m} m",
                found=f"room for {len(found)}",
            )
        ]
    )
