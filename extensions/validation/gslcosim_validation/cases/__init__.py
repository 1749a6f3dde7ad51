"""Cases of `gslcosim reality`, by name; a module each, imported when it is run."""

import importlib
from collections.abc import Sequence

from gslcosim.base.errors import UsageError
from gslcosim_validation.results import Case

# Name of a case: its module in this package, which has it as CASE. The page keeps this order.
CASE_MODULES = {
    "room-wind": "room_wind",
    "step-wind": "step_wind",
    "heated-cavity": "heated_cavity",
    "leak-box": "leak_box",
    "laser-forward": "laser_forward",
    "laser-source": "laser_source",
    "network-forward": "network_forward",
    "network-events": "network_events",
    "room-sensors": "room_sensors",
    "gas-models": "gas_models",
    "roof-tracer": "roof_tracer",
}


def load_case(name: str) -> Case:
    """Return a case by its name."""
    if name not in CASE_MODULES:
        raise UsageError(f"--only: expected cases among {', '.join(CASE_MODULES)}, was {name}.")
    return importlib.import_module(f"{__name__}.{CASE_MODULES[name]}").CASE


def load_cases(names: Sequence[str] = ()) -> tuple[Case, ...]:
    """Return the cases of these names in the page's order, by default all."""
    for name in names:
        load_case(name)
    return tuple(load_case(name) for name in CASE_MODULES if not names or name in names)
