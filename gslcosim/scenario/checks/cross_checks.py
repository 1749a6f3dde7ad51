"""Checks of a scenario between its distant parts, on plain values so that no problem hides another."""

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, cast

from gslcosim.base.errors import VehicleError
from gslcosim.base.gases import GASES
from gslcosim.base.problems import Problem
from gslcosim.base.quantities import PHYSICS_STEP_MS
from gslcosim.base.scenario_keys import find_inputs, list_scenario_keys
from gslcosim.base.ticks import NS_PER_S, seconds_from_ticks
from gslcosim.contract.participant_messages import find_room_output
from gslcosim.scenario.checks.program_checks import find_command_problem, find_python_problem
from gslcosim.scenario.models.base import Spec
from gslcosim.scenario.models.events import VALUE_PATTERN
from gslcosim.scenario.models.gas import EVEN_RELEASES
from gslcosim.scenario.models.participants import ParticipantProgramSpec
from gslcosim.scenario.models.scenario import GasSpec, RecordingSpec, Scenario, StopSpec
from gslcosim.scenario.models.sensors import (
    SENSOR_BLOCKS,
    MeasuringSensorSpec,
    SensorSpec,
    has_estimates,
    mox_sensor_names,
    sensor_names,
)
from gslcosim.scenario.problems import child_path, did_you_mean
from gslcosim.vehicles import get_vehicle, is_vehicle

NS_PER_MS = 1_000_000
MAX_NUMBER = 1e15
"""The largest number of any use, in whatever unit."""

MAX_DURATION_S = 1e9
"""Longer than any run; ticks of it still fit into 64 bits of nanoseconds."""

_DISTURBING = {"sensor_biased": "bias", "sensor_drifts": "drift_per_s"}
_USUAL_VEHICLE = "iris"
TO_ALL = "all"
# Durations of sensors that have to be whole ticks, in blocks that have them.
_SENSOR_TIMES = frozenset({"period_s", "delay_s", "warm_up_s", "averaging_s"})


def find_numbers_too_large(values: object, path: str = "") -> Iterator[Problem]:
    """Yield the problem of each number beyond `MAX_NUMBER`: checks and services may multiply their inputs."""
    if isinstance(values, dict):
        for key, value in cast("dict[str, object]", values).items():
            # An agent's parameters have a meaning for the agent alone.
            if key != "parameters":
                yield from find_numbers_too_large(value, child_path(path, key))
    elif isinstance(values, list):
        for i, value in enumerate(cast("list[object]", values)):
            yield from find_numbers_too_large(value, child_path(path, i))
    elif isinstance(values, int | float) and MAX_NUMBER < abs(values) < math.inf:
        is_real = isinstance(values, float)
        found = f"{values:g}" if is_real else f"a whole number of {len(str(abs(values)))} digits"
        yield Problem(where=path, expected=f"a number of at most {MAX_NUMBER:g}", found=found)


def find_partial_ticks(path: str, duration_s: float | None, tick_ns: int) -> Iterator[Problem]:
    """Yield a problem if a duration [s] is given and is not a whole number of ticks."""
    if duration_s is None or not duration_s > 0:
        return
    if duration_s > MAX_DURATION_S:
        yield Problem(where=path, expected=f"at most {MAX_DURATION_S:g} s", found=f"{duration_s:g} s")
        return
    if is_whole(duration_s, tick_ns):
        return
    below = int(duration_s * NS_PER_S // tick_ns)
    nearest = [f"{seconds_from_ticks(n, tick_ns):g}" for n in (below, below + 1) if n >= 1]
    yield Problem(
        where=path,
        expected=f"a whole number of {tick_ns / NS_PER_MS:g} ms ticks",
        found=f"{duration_s:g} s",
        remedy=f"Nearest: {' or '.join(nearest)}.",
    )


def is_whole(duration_s: float, part_ns: int) -> bool:
    """Return whether a duration is a whole number of parts, at least one, to half a nanosecond."""
    n = round(duration_s * NS_PER_S / part_ns)
    return n >= 1 and abs(n * part_ns - duration_s * NS_PER_S) <= 0.5


def block_in(values: dict[str, Any], *keys: str) -> dict[str, Any]:
    """Return the block at a path of keys; an empty one if there is none."""
    for key in keys:
        inner = values.get(key)
        values = cast("dict[str, Any]", inner) if isinstance(inner, dict) else {}
    return values


def blocks_in(values: dict[str, Any], key: str) -> list[tuple[int, dict[str, Any]]]:
    """Return the blocks of a list with their indices; other items are left out."""
    items = values.get(key)
    if not isinstance(items, list):
        return []
    return [(i, item) for i, item in enumerate(cast("list[Any]", items)) if isinstance(item, dict)]


def words_in(value: Any) -> tuple[str, ...]:
    """Return the texts of a list; nothing if it is not a list of texts."""
    if not isinstance(value, list):
        return ()
    words = cast("list[Any]", value)
    return tuple(words) if all(isinstance(word, str) for word in words) else ()


def number_in(block: dict[str, Any], key: str, model: type[Spec]) -> float | None:
    """Return the number at a key, its default if absent, or None if it is not a number."""
    return _real(block[key] if key in block else model.model_fields[key].default)


def build_unknown_name_problem(path: str, name: str, known: Sequence[str]) -> Problem:
    """Return the problem of a name that is not among the known ones."""
    return Problem(
        where=path,
        expected=f"one of {', '.join(known[:-1])} or {known[-1]}",
        found=f"'{name}'",
        remedy=did_you_mean(name, known),
    )


def find_event_problems(values: dict[str, Any]) -> Iterator[Problem]:
    """Yield the conflicts between a scenario's events and the rest of its plain values."""
    yield from _wrong_doors(values)
    for i, event in blocks_in(values, "events"):
        path = f"events[{i}]"
        yield from _wrong_times(event, values, path)
        yield from _wrong_agents(event, values, path)
        yield from _wrong_value(block_in(event, "when"), values, f"{path}.when")
        for beginning, find in _EVENT_RULES.items():
            if str(event.get("what")).startswith(beginning):
                yield from find(event, values, path)


def _wrong_times(event: dict[str, Any], values: dict[str, Any], path: str) -> Iterator[Problem]:
    tick_ms = number_in(values, "tick_ms", Scenario)
    limit_s = number_in(block_in(values, "referee", "stop"), "time_limit_s", StopSpec)
    at_s, delay_s = _real(event.get("at_s")), _real(block_in(event, "when").get("delay_s"))
    if tick_ms is not None and tick_ms >= 1 and tick_ms == int(tick_ms):
        yield from find_partial_ticks(f"{path}.at_s", at_s, int(tick_ms) * NS_PER_MS)
        yield from find_partial_ticks(f"{path}.when.delay_s", delay_s, int(tick_ms) * NS_PER_MS)
    if at_s is not None and limit_s is not None and at_s > limit_s:
        yield Problem(
            where=f"{path}.at_s",
            expected=f"a time up to the end of the run, {limit_s:g} s",
            found=f"{at_s:g} s",
            remedy="Let it happen sooner, or raise referee.stop.time_limit_s.",
        )


def _wrong_agents(event: dict[str, Any], values: dict[str, Any], path: str) -> Iterator[Problem]:
    names = list(_named(values, "agents"))
    trigger = block_in(event, "when").get("agent")
    for place, agent in ((f"{path}.agent", event.get("agent")), (f"{path}.when.agent", trigger)):
        if isinstance(agent, str) and agent not in names:
            yield _not_there(place, "agent", agent, names)


# The names that a program writes are known only in the run, unless its block lists them.
def _wrong_value(trigger: dict[str, Any], values: dict[str, Any], path: str) -> Iterator[Problem]:
    owners = _named(values, "participants")
    owner, value = trigger.get("participant"), trigger.get("value")
    if not isinstance(owner, str):
        return
    if owner not in owners:
        yield _not_there(f"{path}.participant", "participant", owner, list(owners))
        return
    if not isinstance(value, str) or VALUE_PATTERN.fullmatch(value) is None:
        return
    word, _, name = value.partition(".")
    words = [each for each in words_in(owners[owner].get("writes")) if find_room_output(each) is None]
    names = list(block_in(owners[owner], "outputs", word))
    if word not in words:
        known, remedy = [f"{each}.NAME" for each in words], did_you_mean(word, words)
    elif names and name not in names:
        known = [f"{word}.{each}" for each in names]
        remedy = did_you_mean(value, known)
    else:
        return
    yield Problem(
        where=f"{path}.value",
        expected=f"a value on a port of {owner}'s own ({', '.join(known) or 'there is none'})",
        found=f"'{value}'",
        remedy=remedy,
    )


def _deaf_gas(values: dict[str, Any], path: str, of: str) -> Iterator[Problem]:
    gas = block_in(values, "gas")
    model = gas.get("model", "filament")
    if model != "filament" or gas.get("tape") is True:
        yield Problem(
            where=f"{path}.what",
            expected=f"no event of {of} with gas that cannot follow it",
            found="gas.tape: true" if model == "filament" else f"gas.model: {model}",
            remedy="Take gas.model: filament without a tape.",
        )


# Another inlet makes another wind only if the wind is solved here.
def _wrong_wind(event: dict[str, Any], values: dict[str, Any], path: str) -> Iterator[Problem]:
    yield from _deaf_gas(values, path, "the wind")
    if event.get("inlet_velocity_m_s") is not None and _has_stored_wind(values):
        yield Problem(
            where=f"{path}.inlet_velocity_m_s",
            expected="none where the wind is stored, and not made of an inlet",
            found="one",
            remedy="Take share, or a wind.solver that makes the wind: built_in, uniform or openfoam.",
        )


def _has_stored_wind(values: dict[str, Any]) -> bool:
    environment, solver = block_in(values, "environment"), block_in(values, "wind").get("solver", "auto")
    comes_with_room = not ({"layout", "geometry"} & environment.keys()) and solver in ("auto", "stored")
    return isinstance(solver, dict) or solver == "stored" or "path" in environment or comes_with_room


# A door changes the wind, so it has to be solved here.
def _wrong_doors(values: dict[str, Any]) -> Iterator[Problem]:
    if blocks_in(block_in(values, "environment"), "doors") and _has_stored_wind(values):
        yield Problem(
            where="environment.doors",
            expected="none where the wind is stored: with a door it would be another",
            found="some",
            remedy="Take environment.layout or geometry, and a wind.solver that makes the wind: built_in or uniform.",
        )


def _wrong_door(event: dict[str, Any], values: dict[str, Any], path: str) -> Iterator[Problem]:
    yield from _deaf_gas(values, path, "a door")
    doors = {str(door.get("name")): door for _, door in blocks_in(block_in(values, "environment"), "doors")}
    name = event.get("door")
    if not isinstance(name, str):
        return
    if name not in doors:
        yield _not_there(f"{path}.door", "door in environment.doors", name, list(doors))
        return
    own = [each for _, each in blocks_in(values, "events") if each.get("door") == name]
    times = {id(each): at_s for each in own if (at_s := _real(each.get("at_s"))) is not None}
    if len(times) < len(own):
        return  # their order is known only in the run
    in_order = sorted(own, key=lambda each: times[id(each)])
    last = in_order[: next(i for i, each in enumerate(in_order) if each is event)][-1:]
    is_open = last[0].get("what") == "door_opens" if last else doors[name].get("is_open", False)
    if is_open is (event.get("what") == "door_opens"):
        since = f"since {times[id(last[0])]:g} s" if last else "from the start"
        yield Problem(
            where=f"{path}.what",
            expected=f"an event of a door that is {'closed' if is_open else 'open'} then",
            found=f"{event.get('what')} of {name}, which is {'open' if is_open else 'closed'} {since}",
            remedy=f"Leave it out, or write is_open: {'false' if is_open else 'true'} at the door.",
        )


def _wrong_source(event: dict[str, Any], values: dict[str, Any], path: str) -> Iterator[Problem]:
    yield from _deaf_gas(values, path, "a source")
    gas = block_in(values, "gas")
    sources = dict(blocks_in(gas, "sources"))
    i = event.get("source", 0)
    if not isinstance(i, int) or isinstance(i, bool) or not sources:
        return
    if i >= len(sources):
        yield Problem(
            where=f"{path}.source",
            expected=f"the place of a source in gas.sources, from 0 to {len(sources) - 1}",
            found=f"{i}",
            remedy="Places count from 0.",
        )
    elif event.get("what") == "source_rate":
        kind = block_in(sources.get(i, {}), "release").get("kind", "constant")
        if kind not in EVEN_RELEASES:
            yield Problem(
                where=f"{path}.source",
                expected=f"a source whose release is {' or '.join(EVEN_RELEASES)}",
                found=f"{i}, whose release is {kind}",
                remedy="A schedule of rates is release: {kind: scheduled, schedule: …}.",
            )


def _wrong_sensor(event: dict[str, Any], values: dict[str, Any], path: str) -> Iterator[Problem]:
    agent, name, what = event.get("agent"), event.get("sensor"), str(event.get("what"))
    if not isinstance(agent, str) or agent not in _named(values, "agents") or not isinstance(name, str):
        return
    sensors = {str(sensor.get("name")): sensor for _, sensor in blocks_in(_named(values, "agents")[agent], "sensors")}
    if name not in sensors:
        yield _not_there(f"{path}.sensor", f"sensor of {agent}", name, list(sensors))
        return
    model = str(sensors[name].get("model"))
    own = SENSOR_BLOCKS.get(model)
    if what in _DISTURBING and own is not None and not issubclass(own, MeasuringSensorSpec):
        yield Problem(
            where=f"{path}.sensor",
            expected=f"a sensor that has {_DISTURBING[what]} as a setting",
            found=f"'{name}', a {model}",
            remedy="It can drop out, stick and recover.",
        )


def _wrong_rotor(event: dict[str, Any], values: dict[str, Any], path: str) -> Iterator[Problem]:
    agent, i = event.get("agent"), event.get("rotor")
    if not isinstance(agent, str) or agent not in _named(values, "agents"):
        return
    model = block_in(_named(values, "agents")[agent], "vehicle").get("model", _USUAL_VEHICLE)
    if not isinstance(model, str) or not is_vehicle(model):
        return
    try:
        rotors = get_vehicle(model).rotors
    except VehicleError:
        return
    if rotors is None:
        yield Problem(
            where=f"{path}.agent",
            expected="an agent whose vehicle has rotors",
            found=f"'{agent}', which has a {model}",
            remedy="Leave the event out.",
        )
    elif isinstance(i, int) and i >= rotors.n_rotors:
        yield Problem(
            where=f"{path}.rotor",
            expected=f"a rotor of {model}, from 0 to {rotors.n_rotors - 1}",
            found=f"{i}",
            remedy="Rotors count from 0.",
        )


def _wrong_channel(event: dict[str, Any], values: dict[str, Any], path: str) -> Iterator[Problem]:
    channels, name = [str(channel.get("name")) for _, channel in blocks_in(values, "channels")], event.get("channel")
    if not channels:
        yield Problem(
            where=f"{path}.what",
            expected="no event of radio in a scenario without channels",
            found=str(event.get("what")),
            remedy="Add channels, or leave the event out.",
        )
    elif isinstance(name, str) and name not in channels:
        yield _not_there(f"{path}.channel", "channel", name, channels)


# Rules of an event, by the beginning of its name.
_EVENT_RULES: dict[str, Callable[[dict[str, Any], dict[str, Any], str], Iterator[Problem]]] = {
    "source_": _wrong_source,
    "wind_changes": _wrong_wind,
    "door_": _wrong_door,
    "sensor_": _wrong_sensor,
    "rotor_weakens": _wrong_rotor,
    "radio_": _wrong_channel,
}


def _named(values: dict[str, Any], key: str) -> dict[str, dict[str, Any]]:
    return {str(block["name"]): block for _, block in blocks_in(values, key) if "name" in block}


def _not_there(path: str, kind: str, name: str, known: Sequence[str]) -> Problem:
    return Problem(
        where=path,
        expected=f"the name of {'an' if kind[0] in 'aeiou' else 'a'} {kind} ({', '.join(known) or 'there is none'})",
        found=f"'{name}'",
        remedy=did_you_mean(name, known),
    )


def _real(value: Any) -> float | None:
    return value if isinstance(value, int | float) and not isinstance(value, bool) else None


def find_cross_problems(values: dict[str, Any], *, directory: Path) -> list[Problem]:
    """Return the problems of plain values that no single block shows.

    Values of a wrong kind are skipped: the models report them.
    """
    return [
        *_repeated_names(values),
        *_wrong_hosts(values),
        *_wrong_members(values),
        *_missing_programs(values, directory),
        *_missing_inputs(values, directory),
        *_unknown_gases(values),
        *_taken_by_estimates(values),
        *_broken_times(values),
        *_unpaced(values),
        *find_event_problems(values),
    ]


def _repeated_names(values: dict[str, Any]) -> Iterator[Problem]:
    for key in ("agents", "channels", "services", "participants", "probes"):
        yield from _repeats(key, blocks_in(values, key))
    for i, agent in blocks_in(values, "agents"):
        yield from _repeats(f"agents[{i}].sensors", blocks_in(agent, "sensors"))
    layout = block_in(block_in(values, "environment"), "layout")
    yield from _repeats("environment.layout.obstacles", blocks_in(layout, "obstacles"))


def _repeats(path: str, blocks: list[tuple[int, dict[str, Any]]]) -> Iterator[Problem]:
    first: dict[str, str] = {}
    for i, block in blocks:
        name = block.get("name")
        if not isinstance(name, str):
            continue
        place = child_path(child_path(path, i), "name")
        if name in first:
            yield Problem(
                where=place,
                expected=f"a name that no other of {path} has",
                found=f"'{name}', as {first[name]}",
                remedy=f"For example {name}_{i + 1}.",
            )
        first.setdefault(name, place)


# An agent in another's process needs one with a process of its own.
def _wrong_hosts(values: dict[str, Any]) -> Iterator[Problem]:
    agents = blocks_in(values, "agents")
    own = [
        str(agent["name"]) for _, agent in agents if "name" in agent and "process_of" not in block_in(agent, "start")
    ]
    for i, agent in agents:
        host = block_in(agent, "start").get("process_of")
        if isinstance(host, str) and host not in own:
            yield Problem(
                where=f"agents[{i}].start.process_of",
                expected=f"an agent with a process of its own ({', '.join(own) or 'there is none'})",
                found=f"'{host}'",
                remedy=did_you_mean(host, own),
            )


def _wrong_members(values: dict[str, Any]) -> Iterator[Problem]:
    agents = _named(values, "agents")
    for i, channel in blocks_in(values, "channels"):
        listed = channel.get("members", TO_ALL)
        members = list(agents) if listed == TO_ALL else words_in(listed)
        for j, member in enumerate(members if listed != TO_ALL else ()):
            if member not in agents:
                yield _not_there(f"channels[{i}].members[{j}]", "agent", member, list(agents))
        yield from _deaf_members(i, [agents[name] for name in dict.fromkeys(members) if name in agents])


# The messages of a channel come with any observation, not only with those that await a command.
def _deaf_members(i_channel: int, members: list[dict[str, Any]]) -> Iterator[Problem]:
    if len(members) == 1:
        yield Problem(
            where=f"channels[{i_channel}].members",
            expected="at least two agents",
            found=str(members[0]["name"]),
            remedy="Leave the channel out, or add an agent.",
        )
    for member in members:
        if member["name"] == TO_ALL:
            yield Problem(
                where=f"channels[{i_channel}].members",
                expected=f"agents with other names than '{TO_ALL}', which addresses all of them",
                found=f"'{TO_ALL}'",
                remedy="Rename the agent.",
            )
        if block_in(member, "start").get("observations") == "asked":
            yield Problem(
                where=f"channels[{i_channel}].members",
                expected="agents that get all observations, for messages come with any of them",
                found=f"'{member['name']}', with start.observations: asked",
                remedy=f"Set observations: all for {member['name']}.",
            )


def _missing_programs(values: dict[str, Any], directory: Path) -> Iterator[Problem]:
    starting = [(key, i, block) for key in ("agents", "participants") for i, block in blocks_in(values, key)]
    for key, i, block in starting:
        start = block_in(block, "start")
        python, command = start.get("python"), start.get("command")
        path = f"{key}[{i}].start"
        problem = None
        if isinstance(python, str):
            problem = find_python_problem(python, directory=directory, path=f"{path}.python")
        elif words := words_in(command):
            problem = find_command_problem(words, directory=directory, path=f"{path}.command")
        if problem:
            yield problem
        for added in list_scenario_keys(f"{key}[].start"):
            text = start.get(added.name)
            if added.file and isinstance(text, str) and not (file := _place(directory, text)).is_file():
                yield _missing(f"{path}.{added.name}", added.file, text, f"file {file}")


def _missing_inputs(values: dict[str, Any], directory: Path) -> Iterator[Problem]:
    for named, place, text in find_inputs(values):
        path, what = _place(directory, text), "file"
        match named.kind:
            case "folder":
                is_there, what = path.is_dir(), "folder but a file" if path.exists() else "folder"
            case "file":
                is_there = path.is_file()
            # A series of files is named by its common beginning, so only the folder is certain to exist.
            case "series":
                path, what = path.parent, "folder"
                is_there = path.is_dir()
            case "file or folder":
                is_there, what = path.exists(), ""
        if not is_there:
            yield _missing(place, named.expected, text, f"{what} {path}".lstrip())


def _place(directory: Path, written: str) -> Path:
    return (directory / Path(written).expanduser()).resolve()


def _missing(path: str, expected: str, written: str, what: str) -> Problem:
    return Problem(where=path, expected=expected, found=f"'{written}'", remedy=f"There is no {what}.")


def _unknown_gases(values: dict[str, Any]) -> Iterator[Problem]:
    gas = block_in(values, "gas")
    defined = [str(block["name"]) for _, block in blocks_in(gas, "define") if "name" in block]
    for i, name in enumerate(defined):
        if name in GASES or name in defined[:i]:
            yield Problem(
                where=f"gas.define[{i}].name",
                expected="a name that no other gas has",
                found=f"'{name}'",
                remedy=f"For example my_{name}.",
            )
    named = [("gas.gas", gas.get("gas"))]
    named += [(f"gas.sources[{i}].gas", source.get("gas")) for i, source in blocks_in(gas, "sources")]
    for path, name in named:
        if isinstance(name, str) and name not in (*GASES, *defined):
            yield build_unknown_name_problem(path, name, (*GASES, *defined))
    for i, block in blocks_in(gas, "define"):
        for j, law in blocks_in(block, "mox"):
            sensor = law.get("sensor")
            if isinstance(sensor, str) and sensor not in mox_sensor_names():
                problem = build_unknown_name_problem(f"gas.define[{i}].mox[{j}].sensor", sensor, mox_sensor_names())
                is_other = sensor in sensor_names()
                yield replace(problem, remedy=f"A {sensor} is no MOX sensor.") if is_other else problem


# The estimate from a MOX sensor's reading has the sensor's name with an ending.
def _taken_by_estimates(values: dict[str, Any]) -> Iterator[Problem]:
    for i, agent in blocks_in(values, "agents"):
        sensors = blocks_in(agent, "sensors")
        taken = {f"{sensor.get('name')}_ppm" for _, sensor in sensors if has_estimates(str(sensor.get("model")))}
        for j, sensor in sensors:
            if str(sensor.get("name")) in taken:
                yield Problem(
                    where=f"agents[{i}].sensors[{j}].name",
                    expected="a name that no estimate of a MOX sensor has",
                    found=f"'{sensor.get('name')}'",
                    remedy="For example true_gas.",
                )


def _broken_times(values: dict[str, Any]) -> Iterator[Problem]:
    tick_ms = number_in(values, "tick_ms", Scenario)
    if tick_ms is None or tick_ms <= 0 or tick_ms != int(tick_ms):
        return
    if tick_ms % PHYSICS_STEP_MS:
        below = max(1, int(tick_ms // PHYSICS_STEP_MS)) * PHYSICS_STEP_MS
        yield Problem(
            where="tick_ms",
            expected=f"a multiple of the physics step of {PHYSICS_STEP_MS} ms",
            found=f"{tick_ms:g}",
            remedy=f"Nearest: {below} or {below + PHYSICS_STEP_MS}.",
        )
    tick_ns = int(tick_ms) * NS_PER_MS
    gas, recording, stop = block_in(values, "gas"), block_in(values, "recording"), block_in(values, "referee", "stop")
    yield from find_partial_ticks("recording.gas_every_s", number_in(recording, "gas_every_s", RecordingSpec), tick_ns)
    yield from find_partial_ticks("referee.stop.time_limit_s", number_in(stop, "time_limit_s", StopSpec), tick_ns)
    for i, participant in blocks_in(values, "participants"):
        period_s = number_in(participant, "period_s", ParticipantProgramSpec)
        yield from find_partial_ticks(f"participants[{i}].period_s", period_s, tick_ns)
    for i, agent in blocks_in(values, "agents"):
        for j, sensor in blocks_in(agent, "sensors"):
            block = SENSOR_BLOCKS.get(str(sensor.get("model")), SensorSpec)
            for key in _SENSOR_TIMES & block.model_fields.keys():
                duration_s = number_in(sensor, key, block)
                yield from find_partial_ticks(f"agents[{i}].sensors[{j}].{key}", duration_s, tick_ns)
    yield from _broken_gas_times(number_in(gas, "step_s", GasSpec), number_in(gas, "warm_up_s", GasSpec), tick_ns)


# Without a clock, arrivals have no time.
def _unpaced(values: dict[str, Any]) -> Iterator[Problem]:
    if values.get("pace") is not None:
        return
    for i, agent in blocks_in(values, "agents"):
        if agent.get("mode") == "free":
            yield Problem(
                where=f"agents[{i}].mode",
                expected="free only where simulated time follows the clock on the wall",
                found="free, without pace",
                remedy="Add pace: 1, or --pace 1 to fly; without a clock take on_request.",
            )


# The fields core steps its gas a whole number of times per tick, or once in a whole number of ticks.
def _broken_gas_times(step_s: float | None, warm_up_s: float | None, tick_ns: int) -> Iterator[Problem]:
    if step_s is None or step_s <= 0:
        return
    step_ns = round(step_s * NS_PER_S)
    if not step_ns or (step_ns % tick_ns and tick_ns % step_ns):
        yield Problem(
            where="gas.step_s",
            expected=f"a whole multiple or a whole fraction of the tick of {tick_ns / NS_PER_S:g} s",
            found=f"{step_s:g} s",
            remedy=f"Nearest: {_nearest_step_s(step_ns, tick_ns):g}.",
        )
    elif warm_up_s is not None and warm_up_s > 0 and not is_whole(warm_up_s, step_ns):
        steps = int(warm_up_s * NS_PER_S // step_ns)
        yield Problem(
            where="gas.warm_up_s",
            expected=f"a whole number of gas steps of {step_s:g} s",
            found=f"{warm_up_s:g} s",
            remedy=f"Nearest: {steps * step_ns / NS_PER_S:g} or {(steps + 1) * step_ns / NS_PER_S:g}.",
        )


def _nearest_step_s(step_ns: int, tick_ns: int) -> float:
    if step_ns > tick_ns:
        return round(step_ns / tick_ns) * tick_ns / NS_PER_S
    n = round(tick_ns / max(step_ns, 1))
    while tick_ns % n:
        n -= 1
    return tick_ns // n / NS_PER_S
