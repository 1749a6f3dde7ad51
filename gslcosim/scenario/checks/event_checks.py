"""Event checks: events about what is not there, too late, or with gas that does not follow."""

from collections.abc import Iterator, Sequence
from typing import Any

from gslcosim.base.errors import VehicleError
from gslcosim.scenario.checks.plain_values import NS_PER_MS, block_in, blocks_in, find_partial_ticks, number_in
from gslcosim.scenario.models.scenario import Scenario, StopSpec
from gslcosim.scenario.models.sensor_base import MeasuringSensorSpec
from gslcosim.scenario.models.sensors import SENSOR_BLOCKS
from gslcosim.scenario.problems import Problem
from gslcosim.scenario.suggestions import did_you_mean
from gslcosim.vehicles import get_vehicle, is_vehicle

_DISTURBING = {"sensor_biased": "bias", "sensor_drifts": "drift_per_s"}
_EVEN_RELEASES = ("constant", "poisson")
_USUAL_VEHICLE = "iris"


def find_event_problems(values: dict[str, Any]) -> Iterator[Problem]:
    """Yield what is wrong between a scenario's events and the rest of its plain values.

    Args:
        values: The scenario as dicts, lists and scalars.
    """
    yield from _wrong_doors(values)
    for i, event in blocks_in(values, "events"):
        path = f"events[{i}]"
        yield from _wrong_times(event, values, path)
        yield from _wrong_agents(event, values, path)
        what = str(event.get("what"))
        if what.startswith("source_"):
            yield from _wrong_source(event, values, path)
        elif what == "wind_changes":
            yield from _wrong_wind(event, values, path)
        elif what.startswith("door_"):
            yield from _wrong_door(event, values, path)
        elif what.startswith("sensor_"):
            yield from _wrong_sensor(event, values, path)
        elif what == "rotor_weakens":
            yield from _wrong_rotor(event, values, path)
        elif what.startswith("radio_"):
            yield from _wrong_channel(event, values, path)


def _wrong_times(event: dict[str, Any], values: dict[str, Any], path: str) -> Iterator[Problem]:
    tick_ms = number_in(values, "tick_ms", Scenario)
    limit_s = number_in(block_in(values, "referee", "stop"), "time_limit_s", StopSpec)
    at_s, delay_s = _real(event.get("at_s")), _real(block_in(event, "when").get("delay_s"))
    if tick_ms is not None and tick_ms >= 1 and tick_ms == int(tick_ms):
        yield from find_partial_ticks(f"{path}.at_s", at_s, int(tick_ms) * NS_PER_MS)
        yield from find_partial_ticks(f"{path}.when.delay_s", delay_s, int(tick_ms) * NS_PER_MS)
    if at_s is not None and limit_s is not None and at_s > limit_s:
        yield Problem(
            path=f"{path}.at_s",
            expected=f"a time up to the end of the run, {limit_s:g} s",
            found=f"{at_s:g} s",
            remedy="Let it happen sooner, or raise referee.stop.time_limit_s.",
        )


def _wrong_agents(event: dict[str, Any], values: dict[str, Any], path: str) -> Iterator[Problem]:
    names = list(_agents(values))
    trigger = block_in(event, "when").get("agent")
    for place, agent in ((f"{path}.agent", event.get("agent")), (f"{path}.when.agent", trigger)):
        if isinstance(agent, str) and agent not in names:
            yield _not_there(place, "agent", agent, names)


def _deaf_gas(values: dict[str, Any], path: str, of: str) -> Iterator[Problem]:
    gas = block_in(values, "gas")
    model = gas.get("model", "filament")
    if model != "filament" or gas.get("tape") is True:
        yield Problem(
            path=f"{path}.what",
            expected=f"no event of {of} with gas that cannot follow it",
            found="gas.tape: true" if model == "filament" else f"gas.model: {model}",
            remedy="Take gas.model: filament without a tape.",
        )


# Another inlet makes another wind only where the wind is made here.
def _wrong_wind(event: dict[str, Any], values: dict[str, Any], path: str) -> Iterator[Problem]:
    yield from _deaf_gas(values, path, "the wind")
    if event.get("inlet_velocity_m_s") is not None and _has_stored_wind(values):
        yield Problem(
            path=f"{path}.inlet_velocity_m_s",
            expected="none where the wind is stored, and not made of an inlet",
            found="one",
            remedy="Take share, or a wind.solver that makes the wind: built_in, uniform or openfoam.",
        )


def _has_stored_wind(values: dict[str, Any]) -> bool:
    environment, solver = block_in(values, "environment"), block_in(values, "wind").get("solver", "auto")
    comes_with_room = not ({"layout", "geometry"} & environment.keys()) and solver in ("auto", "stored")
    return isinstance(solver, dict) or solver == "stored" or "path" in environment or comes_with_room


# With a door the wind is another, so it has to be made here.
def _wrong_doors(values: dict[str, Any]) -> Iterator[Problem]:
    if blocks_in(block_in(values, "environment"), "doors") and _has_stored_wind(values):
        yield Problem(
            path="environment.doors",
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
        return  # which comes first is known in the run only
    in_order = sorted(own, key=lambda each: times[id(each)])
    last = in_order[: next(i for i, each in enumerate(in_order) if each is event)][-1:]
    is_open = last[0].get("what") == "door_opens" if last else doors[name].get("is_open", False)
    if is_open is (event.get("what") == "door_opens"):
        since = f"since {times[id(last[0])]:g} s" if last else "from the start"
        yield Problem(
            path=f"{path}.what",
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
            path=f"{path}.source",
            expected=f"the place of a source in gas.sources, from 0 to {len(sources) - 1}",
            found=f"{i}",
            remedy="Places count from 0.",
        )
    elif event.get("what") == "source_rate":
        kind = block_in(sources.get(i, {}), "release").get("kind", "constant")
        if kind not in _EVEN_RELEASES:
            yield Problem(
                path=f"{path}.source",
                expected=f"a source whose release is {' or '.join(_EVEN_RELEASES)}",
                found=f"{i}, whose release is {kind}",
                remedy="A schedule of rates is release: {kind: scheduled, schedule: …}.",
            )


def _wrong_sensor(event: dict[str, Any], values: dict[str, Any], path: str) -> Iterator[Problem]:
    agent, name, what = event.get("agent"), event.get("sensor"), str(event.get("what"))
    if not isinstance(agent, str) or agent not in _agents(values) or not isinstance(name, str):
        return
    sensors = {str(sensor.get("name")): sensor for _, sensor in blocks_in(_agents(values)[agent], "sensors")}
    if name not in sensors:
        yield _not_there(f"{path}.sensor", f"sensor of {agent}", name, list(sensors))
        return
    model = str(sensors[name].get("model"))
    own = SENSOR_BLOCKS.get(model)
    if what in _DISTURBING and own is not None and not issubclass(own, MeasuringSensorSpec):
        yield Problem(
            path=f"{path}.sensor",
            expected=f"a sensor that has {_DISTURBING[what]} as a setting",
            found=f"'{name}', a {model}",
            remedy="It can drop out, stick and recover.",
        )


def _wrong_rotor(event: dict[str, Any], values: dict[str, Any], path: str) -> Iterator[Problem]:
    agent, i = event.get("agent"), event.get("rotor")
    if not isinstance(agent, str) or agent not in _agents(values):
        return
    model = block_in(_agents(values)[agent], "vehicle").get("model", _USUAL_VEHICLE)
    if not isinstance(model, str) or not is_vehicle(model):
        return
    try:
        rotors = get_vehicle(model).rotors
    except VehicleError:
        return
    if rotors is None:
        yield Problem(
            path=f"{path}.agent",
            expected="an agent whose vehicle has rotors",
            found=f"'{agent}', which has a {model}",
            remedy="Leave the event out.",
        )
    elif isinstance(i, int) and i >= rotors.n_rotors:
        yield Problem(
            path=f"{path}.rotor",
            expected=f"a rotor of {model}, from 0 to {rotors.n_rotors - 1}",
            found=f"{i}",
            remedy="Rotors count from 0.",
        )


def _wrong_channel(event: dict[str, Any], values: dict[str, Any], path: str) -> Iterator[Problem]:
    channels, name = [str(channel.get("name")) for _, channel in blocks_in(values, "channels")], event.get("channel")
    if not channels:
        yield Problem(
            path=f"{path}.what",
            expected="no event of radio in a scenario without channels",
            found=str(event.get("what")),
            remedy="Add channels, or leave the event out.",
        )
    elif isinstance(name, str) and name not in channels:
        yield _not_there(f"{path}.channel", "channel", name, channels)


def _agents(values: dict[str, Any]) -> dict[str, dict[str, Any]]:
    return {str(agent["name"]): agent for _, agent in blocks_in(values, "agents") if "name" in agent}


def _not_there(path: str, kind: str, name: str, known: Sequence[str]) -> Problem:
    return Problem(
        path=path,
        expected=f"the name of {'an' if kind[0] in 'aeiou' else 'a'} {kind} ({', '.join(known) or 'there is none'})",
        found=f"'{name}'",
        remedy=did_you_mean(name, known),
    )


def _real(value: Any) -> float | None:
    return value if isinstance(value, int | float) and not isinstance(value, bool) else None
