"""Scenario in a small room that gives a bundled agent everything its method's card requires."""

from pathlib import Path
from typing import Any

from gslcosim.methods.card import MethodCard, Needs
from gslcosim.scenario.loader import load_scenario, resolve_values
from gslcosim.scenario.models.scenario import Scenario
from gslcosim.scenario.serialization import plain_values

METHOD_SCENARIO = "tiny_room"
# Long enough for methods to meet gas, plan and move; none succeeds before.
TIME_LIMIT_S = 60.0


def build_method_scenario(name: str, card: MethodCard | None, directory: Path) -> Scenario:
    """Return a scenario in a small room that gives a bundled agent everything its card requires."""
    values = plain_values(load_scenario(METHOD_SCENARIO).scenario)
    needs, robots = (card.needs, card.robots) if card is not None else (Needs(), 1)
    first = values["agents"][0]
    first["start"] = {"python": name}
    first["knows"] = dict.fromkeys(needs.knows, True)
    model = "pid" if "gas_ppm" in needs.sensors else "tgs2600"
    camera = [{"model": "camera", "name": "eye", "period_s": 0.5}] if "camera" in needs.sensors else []
    first["sensors"] = [{"model": model, "name": "nose"}, {"model": "anemometer", "name": "wind"}, *camera]
    n_robots = robots if isinstance(robots, int) else robots[0]
    values["agents"] = [first, *(_build_robot(first, i) for i in range(1, n_robots))]
    if needs.radio:
        values["channels"] = [{"name": "radio"}]
    values["referee"]["success"] = {"within_m": 0.01, "of": "source"}
    values["referee"]["stop"] = {"time_limit_s": TIME_LIMIT_S}
    values["recording"] = {"enabled": False}
    return resolve_values(values, directory, source=f"the small room of {name}")


# In a row along the room, apart from each other.
def _build_robot(first: dict[str, Any], i: int) -> dict[str, Any]:
    x_m, y_m, z_m = first["vehicle"]["start_m"]
    vehicle = {**first["vehicle"], "start_m": [x_m - i, y_m, z_m], "separation_m": 0.4}
    return {**first, "name": f"robot_{i + 1}", "start": {"process_of": first["name"]}, "vehicle": vehicle}
