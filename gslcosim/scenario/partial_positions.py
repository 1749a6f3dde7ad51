"""Positions of a scenario that has problems elsewhere, so that they can be checked all the same."""

from collections.abc import Iterable
from typing import Any, cast

_SAYS_NOTHING_OF_PLACES = ("schema", "name", "seed", "tick_ms", "referee", "recording")


def extract_position_values(values: dict[str, Any], problem_paths: Iterable[str]) -> dict[str, Any] | None:
    """Return a scenario that has the places of a faulty one and nothing else of it.

    Returns nothing when a problem concerns what says where things are: no place is ever guessed.

    Args:
        values: The faulty scenario as plain values.
        problem_paths: Where its problems are.
    """
    agents = values.get("agents")
    if not isinstance(agents, list) or any(_concerns_places(path) for path in problem_paths):
        return None
    places = {
        "schema": "gslcosim/scenario/1",
        "name": "places",
        "environment": values.get("environment"),
        "gas": {"sources": _get(values.get("gas"), "sources")},
        "agents": [_agent(i, agent) for i, agent in enumerate(cast("list[Any]", agents))],
    }
    return {**places, "wind": values["wind"]} if "wind" in values else places


def _agent(index: int, agent: Any) -> dict[str, Any]:
    return {
        "name": f"agent_{index}",
        "start": {"attach": True},
        "vehicle": _get(agent, "vehicle"),
        "sensors": [{"model": "anemometer", "name": "wind"}],
    }


def _concerns_places(path: str) -> bool:
    top, *inner = path.replace("[", ".").replace("]", "").split(".")
    if top in _SAYS_NOTHING_OF_PLACES:
        return False
    if top == "gas":
        return not inner or inner[0] == "sources"
    if top == "agents":
        return len(inner) < 2 or inner[1] == "vehicle"
    return True


def _get(values: Any, key: str) -> Any:
    return cast("dict[str, Any]", values).get(key) if isinstance(values, dict) else None
