"""`gslcosim list`: what there is to put into a scenario."""

import argparse
import ast
from collections.abc import Callable
from pathlib import Path

from gslcosim.cli.parsing import Command
from gslcosim.cli.terminal import add_json_option, table, write, write_json

EXAMPLES = """  gslcosim list
  gslcosim list sensors
  gslcosim list scenarios --json"""

Row = dict[str, str]


def _scenarios() -> list[Row]:
    from gslcosim.scenario.bundled import bundled_scenarios

    return [
        {"name": name, "description": _first_comment(path), "file": str(path)}
        for name, path in bundled_scenarios().items()
    ]


def _agents() -> list[Row]:
    from gslcosim.scenario.bundled import bundled_agents

    return [
        {"name": name, "description": _first_docstring_line(path), "file": str(path)}
        for name, path in bundled_agents().items()
    ]


def _sensors() -> list[Row]:
    from gslcosim.sensing.models import sensor_kind, sensor_names

    return [
        {"name": kind.name, "quantity": kind.quantity, "unit": kind.unit, "description": kind.description}
        for kind in map(sensor_kind, sensor_names())
    ]


def _vehicles() -> list[Row]:
    from gslcosim.vehicles import vehicle_names, vehicle_of

    return [
        {
            "name": vehicle.name,
            "kind": vehicle.kind,
            "mass_kg": f"{vehicle.body.mass_kg:g}",
            "width_m": f"{2 * vehicle.body.radius_m:g}",
            "description": vehicle.description,
        }
        for vehicle in map(vehicle_of, vehicle_names())
    ]


def _gases() -> list[Row]:
    from gslcosim.fields.gases import GASES

    return [{"name": gas.name, "density_relative_to_air": f"{gas.specific_gravity:g}"} for gas in GASES.values()]


def _layouts() -> list[Row]:
    from gslcosim.scenario.schema_walk import blocks_of, slot_at

    blocks = blocks_of(slot_at(("environment", "layout")).annotation)
    return [{"name": name, "description": (block.__doc__ or "").partition("\n")[0]} for name, block in blocks.items()]


KINDS: dict[str, Callable[[], list[Row]]] = {
    "scenarios": _scenarios,
    "agents": _agents,
    "sensors": _sensors,
    "vehicles": _vehicles,
    "gases": _gases,
    "layouts": _layouts,
}


def _add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "kind", nargs="?", choices=sorted(KINDS), metavar="KIND", help=f"{', '.join(KINDS)} (default: all of them)"
    )
    add_json_option(parser)


def _run(arguments: argparse.Namespace) -> int:
    kinds = [arguments.kind] if arguments.kind else list(KINDS)
    found = {kind: KINDS[kind]() for kind in kinds}
    if arguments.json:
        write_json(found)
        return 0
    for i, (kind, rows) in enumerate(found.items()):
        if arguments.kind is None:
            write(f"{'' if i == 0 else chr(10)}{kind.upper()}")
        headings = [heading for heading in rows[0] if heading != "file"] if rows else ["name"]
        write(table([h.replace("_", " ") for h in headings], [[row[h] for h in headings] for row in rows]))
    return 0


def _first_comment(path: Path) -> str:
    first = path.read_text(encoding="utf-8").lstrip().partition("\n")[0]
    return first.lstrip("# ").strip() if first.startswith("#") else ""


# Read, not imported: an agent's program may do anything when it is imported.
def _first_docstring_line(path: Path) -> str:
    docstring = ast.get_docstring(ast.parse(path.read_text(encoding="utf-8"))) or ""
    return docstring.partition("\n")[0]


COMMAND = Command(
    name="list",
    summary="list scenarios, agents, sensors, vehicles, gases or layouts",
    examples=EXAMPLES,
    add_arguments=_add_arguments,
    run=_run,
)
