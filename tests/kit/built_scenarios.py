"""Scenarios that tests make up: whole ones of which a test names what it is about."""

from collections.abc import Sequence
from typing import Any

from gslcosim.scenario.models.scenario import Scenario

NOSE = {"model": "tgs2600", "name": "nose"}


def build_agent(
    name: str = "beetle",
    start_m=(3.0, 3.0, 0.2),
    *,
    sensors: Sequence[dict[str, Any]] = (NOSE,),
    vehicle: dict[str, Any] | None = None,
    **fields: Any,
) -> dict[str, Any]:
    """Return the block of an agent that flies with a gas sensor."""
    own = {"name": name, "start": {"python": "dung_beetle"}, "vehicle": {"start_m": start_m, **(vehicle or {})}}
    return {**own, "sensors": sensors, **fields}


def build_scenario(*agents: dict[str, Any], **fields: Any) -> Scenario:
    """Return a scenario of these agents, by default of one, in the default room with a source at (5, 1, 2) m."""
    whole = {
        "schema": "gslcosim/scenario/1",
        "name": "test",
        "environment": {"layout": {}},
        "gas": {"sources": [{"position_m": (5.0, 1.0, 2.0)}]},
        "agents": agents or (build_agent(),),
    }
    whole |= fields
    if whole["gas"].get("model", "filament") == "filament":
        # Rooms that tests make up have no k and epsilon.
        whole["gas"] = {"turbulence": {"kind": "none"}, **whole["gas"]}
    return Scenario.model_validate(whole)
