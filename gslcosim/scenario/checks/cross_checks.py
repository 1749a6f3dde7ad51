"""Cross checks: rules between distant parts of a scenario, on plain values so that no problem hides another."""

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

from gslcosim.base.quantities import PHYSICS_STEP_MS
from gslcosim.base.ticks import NS_PER_S
from gslcosim.scenario.checks.event_checks import find_event_problems
from gslcosim.scenario.checks.plain_values import (
    NS_PER_MS,
    block_in,
    blocks_in,
    build_unknown_name_problem,
    find_partial_ticks,
    is_whole,
    number_in,
    words_in,
)
from gslcosim.scenario.checks.program_checks import find_command_problem, find_python_problem
from gslcosim.scenario.models.gas import GASES
from gslcosim.scenario.models.participants import ParticipantProgramSpec
from gslcosim.scenario.models.scenario import FOLDER_KEYS, GasSpec, RecordingSpec, Scenario, StopSpec
from gslcosim.scenario.models.sensors import SENSOR_BLOCKS, SensorSpec, has_estimates, mox_sensor_names, sensor_names
from gslcosim.scenario.problems import Problem, child_path
from gslcosim.scenario.suggestions import did_you_mean

TO_ALL = "all"
# What sensors count in ticks, where they have it.
_SENSOR_TIMES = frozenset({"period_s", "delay_s", "warm_up_s", "averaging_s"})


def find_cross_problems(values: dict[str, Any], *, directory: Path) -> list[Problem]:
    """Return the problems of plain values that no single block shows.

    Values of a wrong kind are passed over: the models complain about them.

    Args:
        values: The scenario as dicts, lists and scalars.
        directory: The scenario's folder; relative paths start there.
    """
    return [
        *_repeated_names(values),
        *_wrong_hosts(values),
        *_wrong_members(values),
        *_missing_programs(values, directory),
        *_missing_environment(values, directory),
        *_missing_geometry(values, directory),
        *_missing_wind(values, directory),
        *_missing_gas_frames(values, directory),
        *_unknown_gases(values),
        *_taken_by_estimates(values),
        *_broken_times(values),
        *_unpaced(values),
        *find_event_problems(values),
    ]


def _repeated_names(values: dict[str, Any]) -> Iterator[Problem]:
    agents = blocks_in(values, "agents")
    yield from _repeats("agents", agents)
    for i, agent in agents:
        yield from _repeats(f"agents[{i}].sensors", blocks_in(agent, "sensors"))
    yield from _repeats("channels", blocks_in(values, "channels"))
    yield from _repeats("services", blocks_in(values, "services"))
    yield from _repeats("participants", blocks_in(values, "participants"))
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
                path=place,
                expected=f"a name that no other of {path} has",
                found=f"'{name}', as {first[name]}",
                remedy=f"For example {name}_{i + 1}.",
            )
        first.setdefault(name, place)


# An agent that flies in another's process needs one that has a process of its own.
def _wrong_hosts(values: dict[str, Any]) -> Iterator[Problem]:
    agents = blocks_in(values, "agents")
    own = [
        str(agent["name"]) for _, agent in agents if "name" in agent and "process_of" not in block_in(agent, "start")
    ]
    for i, agent in agents:
        host = block_in(agent, "start").get("process_of")
        if isinstance(host, str) and host not in own:
            yield Problem(
                path=f"agents[{i}].start.process_of",
                expected=f"an agent with a process of its own ({', '.join(own) or 'there is none'})",
                found=f"'{host}'",
                remedy=did_you_mean(host, own),
            )


def _wrong_members(values: dict[str, Any]) -> Iterator[Problem]:
    agents = {str(agent["name"]): agent for _, agent in blocks_in(values, "agents") if "name" in agent}
    for i, channel in blocks_in(values, "channels"):
        listed = channel.get("members", TO_ALL)
        members = list(agents) if listed == TO_ALL else words_in(listed)
        for j, member in enumerate(members if listed != TO_ALL else ()):
            if member not in agents:
                yield Problem(
                    path=f"channels[{i}].members[{j}]",
                    expected=f"the name of an agent ({', '.join(agents)})",
                    found=f"'{member}'",
                    remedy=did_you_mean(member, list(agents)),
                )
        yield from _deaf_members(i, [agents[name] for name in dict.fromkeys(members) if name in agents])


# What a channel brings comes with any observation, not only with those that ask for a command.
def _deaf_members(i_channel: int, members: list[dict[str, Any]]) -> Iterator[Problem]:
    if len(members) == 1:
        yield Problem(
            path=f"channels[{i_channel}].members",
            expected="at least two agents",
            found=str(members[0]["name"]),
            remedy="Leave the channel out, or add an agent.",
        )
    for member in members:
        if member["name"] == TO_ALL:
            yield Problem(
                path=f"channels[{i_channel}].members",
                expected=f"agents with other names than '{TO_ALL}', which addresses all of them",
                found=f"'{TO_ALL}'",
                remedy="Rename the agent.",
            )
        if block_in(member, "start").get("observations") == "asked":
            yield Problem(
                path=f"channels[{i_channel}].members",
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


def _missing_environment(values: dict[str, Any], directory: Path) -> Iterator[Problem]:
    for key in FOLDER_KEYS:
        path = block_in(values, "environment").get(key)
        if isinstance(path, str) and not (folder := _place(directory, path)).is_dir():
            kind = "folder but a file" if folder.exists() else "folder"
            yield _missing(f"environment.{key}", "the folder of an environment", path, f"{kind} {folder}")


def _missing_geometry(values: dict[str, Any], directory: Path) -> Iterator[Problem]:
    files = block_in(values, "environment", "geometry").get("files")
    for i, file in enumerate(words_in(files)):
        if not (path := _place(directory, file)).is_file():
            yield _missing(f"environment.geometry.files[{i}]", "a file of geometry", file, f"file {path}")


# A series of files is named by its common beginning, so only the folder is sure to be there.
def _missing_wind(values: dict[str, Any], directory: Path) -> Iterator[Problem]:
    file = block_in(values, "wind", "solver").get("file")
    if isinstance(file, str) and not (folder := _place(directory, file).parent).is_dir():
        yield _missing("wind.solver.file", "a file or folder with wind", file, f"folder {folder}")


def _missing_gas_frames(values: dict[str, Any], directory: Path) -> Iterator[Problem]:
    folder = block_in(values, "gas", "playback").get("folder")
    if isinstance(folder, str) and not (path := _place(directory, folder)).exists():
        yield _missing("gas.playback.folder", "a folder of gas frames, or a movie", folder, str(path))


def _place(directory: Path, written: str) -> Path:
    return (directory / Path(written).expanduser()).resolve()


def _missing(path: str, expected: str, written: str, what: str) -> Problem:
    return Problem(path=path, expected=expected, found=f"'{written}'", remedy=f"There is no {what}.")


def _unknown_gases(values: dict[str, Any]) -> Iterator[Problem]:
    gas = block_in(values, "gas")
    defined = [str(block["name"]) for _, block in blocks_in(gas, "define") if "name" in block]
    for i, name in enumerate(defined):
        if name in GASES or name in defined[:i]:
            yield Problem(
                path=f"gas.define[{i}].name",
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


# What is estimated from a MOX sensor's reading is reported under the sensor's name with an ending.
def _taken_by_estimates(values: dict[str, Any]) -> Iterator[Problem]:
    for i, agent in blocks_in(values, "agents"):
        sensors = blocks_in(agent, "sensors")
        taken = {f"{sensor.get('name')}_ppm" for _, sensor in sensors if has_estimates(str(sensor.get("model")))}
        for j, sensor in sensors:
            if str(sensor.get("name")) in taken:
                yield Problem(
                    path=f"agents[{i}].sensors[{j}].name",
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
            path="tick_ms",
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


# Without a clock there is no saying when something came.
def _unpaced(values: dict[str, Any]) -> Iterator[Problem]:
    if values.get("pace") is not None:
        return
    for i, agent in blocks_in(values, "agents"):
        if agent.get("mode") == "free":
            yield Problem(
                path=f"agents[{i}].mode",
                expected="free only where simulated time follows the clock on the wall",
                found="free, without pace",
                remedy="Add pace: 1, or --pace 1 to fly; without a clock take on_request.",
            )


# The fields core steps its gas a whole number of times a tick, or every whole number of ticks.
def _broken_gas_times(step_s: float | None, warm_up_s: float | None, tick_ns: int) -> Iterator[Problem]:
    if step_s is None or step_s <= 0:
        return
    step_ns = round(step_s * NS_PER_S)
    if not step_ns or (step_ns % tick_ns and tick_ns % step_ns):
        yield Problem(
            path="gas.step_s",
            expected=f"a whole multiple or a whole fraction of the tick of {tick_ns / NS_PER_S:g} s",
            found=f"{step_s:g} s",
            remedy=f"Nearest: {_nearest_step_s(step_ns, tick_ns):g}.",
        )
    elif warm_up_s is not None and warm_up_s > 0 and not is_whole(warm_up_s, step_ns):
        steps = int(warm_up_s * NS_PER_S // step_ns)
        yield Problem(
            path="gas.warm_up_s",
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
