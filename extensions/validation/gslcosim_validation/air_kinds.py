"""Kinds of air: open ground, rooms with forced wind, and rooms whose wind heat or a light or heavy gas drives."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any, Literal

from gslcosim.environment.generation.provenance import read_made_from
from gslcosim.environment.store import HEADER_FILE
from gslcosim.scenario import Scenario

AirKind = Literal["open_ground", "room_with_forced_wind", "room_with_heat"]
AIR_KINDS: Mapping[AirKind, str] = {
    "open_ground": "open ground",
    "room_with_forced_wind": "room with forced wind",
    "room_with_heat": "room with heat or buoyant gas",
}
"""All kinds of air, with their words."""
_OUTDOORS = "plant"


def find_air_kind(scenario: Scenario, folder: Path | None = None) -> AirKind:
    """Return the kind of a run's air.

    - `room_with_heat`: `environment.heat` or `wind.buoyancy` drives its wind.
    - `open_ground`: uniform wind, a layout outdoors, or gas whose air goes on beyond the room (`farrell`, formulas).
    - `room_with_forced_wind`: all others, with what is imported or played back from rooms of others.

    Args:
        scenario: The run's.
        folder: The environment folder of the run; of one that the scenario names by `environment.path`, room and wind
            are as its header says.
    """
    environment = scenario.environment
    if environment.path is None:
        room: Mapping[str, Any] = environment.model_dump(exclude_none=True)
        wind: Mapping[str, Any] = scenario.wind.model_dump(exclude_none=True)
    else:
        room = {} if folder is None else read_made_from(folder / HEADER_FILE)
        wind = _get_block(room, "wind")
    if room.get("heat") or wind.get("buoyancy"):
        return "room_with_heat"
    if scenario.gas.stored_folder is not None:
        return "room_with_forced_wind"
    is_outdoors = _get_block(room, "layout").get("kind") == _OUTDOORS or wind.get("solver") == "uniform"
    if is_outdoors or getattr(scenario.gas, "is_in_open_air", False):
        return "open_ground"
    return "room_with_forced_wind"


# Of a header that others may have written.
def _get_block(values: Mapping[str, Any], key: str) -> Mapping[str, Any]:
    block = values.get(key)
    return block if isinstance(block, Mapping) else {}
