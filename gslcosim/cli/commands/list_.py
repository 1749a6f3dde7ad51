"""`gslcosim list`: building blocks of scenarios."""

import argparse
from collections.abc import Callable
from dataclasses import asdict
from functools import partial
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any

from gslcosim.base.plugins import PluginError
from gslcosim.cli.arguments import Command
from gslcosim.cli.terminal import add_json_option, table, write, write_json

if TYPE_CHECKING:
    from pydantic import BaseModel

    from gslcosim.scenario.models.base import OneOf

EXAMPLES = """  gslcosim list
  gslcosim list sensors
  gslcosim list scenarios --json"""

Row = dict[str, Any]
# Columns that are left out of a table on a terminal.
_HIDDEN = ("file", "settings")


def _bundled(kind: str, describe: Callable[[Path], str]) -> list[Row]:
    from gslcosim.base import bundled

    files: dict[str, Path] = getattr(bundled, f"bundled_{kind}")()
    return [{"name": name, "description": describe(path), "file": str(path)} for name, path in files.items()]


def _first_comment(path: Path) -> str:
    from gslcosim.base.yaml_core import without_editor_header

    first = without_editor_header(path.read_bytes()).decode().lstrip().partition("\n")[0]
    return first.lstrip("# ").strip() if first.startswith("#") else ""


def _summary_of_card(program: Path) -> str:
    from gslcosim.methods.card import find_card_beside

    card = find_card_beside(program)
    return f"{card.title}: {card.summary}" if card is not None else ""


def _sensors() -> list[Row]:
    from gslcosim_services.sensing.models import sensor_kind, sensor_names

    return [
        {
            "name": kind.name,
            "quantity": kind.quantity,
            "unit": kind.unit,
            "description": kind.description,
            "settings": _settings(kind.settings, kind.name, "model"),
        }
        for kind in map(sensor_kind, sensor_names())
    ]


# A package has to be imported to be listed; one that fails is reported in its row, and hides no other.
def _kinds_at(module: str, name: str) -> list[Row]:
    one_of: OneOf = getattr(import_module(f"gslcosim.scenario.models.{module}"), name)
    rows: list[Row] = []
    offered = one_of.offers.names() if one_of.offers else ()
    for name in (*one_of.own, *(name for name in offered if name not in one_of.own)):
        try:
            block = one_of.block_of(name)
        except PluginError as error:
            rows.append({"name": name, "description": str(error), "settings": []})
            continue
        assert block is not None, "every name has a block"
        description = one_of.descriptions.get(name, (block.__doc__ or "").partition("\n")[0])
        rows.append({"name": name, "description": description, "settings": _settings(block, name, one_of.tag_key)})
    return rows


def _settings(block: type["BaseModel"], kind: str, tag_key: str) -> list[Row]:
    from gslcosim.scenario.model_schema import list_settings

    return [asdict(each) for each in list_settings(block, kind=kind, without=frozenset({tag_key}))]


def _vehicles() -> list[Row]:
    from gslcosim.vehicles import get_vehicle, list_vehicle_names

    return [
        {
            "name": vehicle.name,
            "kind": vehicle.kind,
            "mass_kg": f"{vehicle.body.mass_kg:g}",
            "width_m": f"{2 * vehicle.body.radius_m:g}",
            "description": vehicle.description,
        }
        for vehicle in map(get_vehicle, list_vehicle_names())
    ]


def _gases() -> list[Row]:
    from gslcosim.base.gases import GASES

    return [{"name": name, "density_relative_to_air": f"{gas.specific_gravity:g}"} for name, gas in GASES.items()]


def _layouts() -> list[Row]:
    from gslcosim.scenario.model_schema import find_schema_node, list_blocks

    blocks = list_blocks(find_schema_node(("environment", "layout")).annotation)
    return [{"name": name, "description": (block.__doc__ or "").partition("\n")[0]} for name, block in blocks.items()]


KINDS: dict[str, Callable[[], list[Row]]] = {
    "scenarios": partial(_bundled, "scenarios", _first_comment),
    "agents": partial(_bundled, "agents", _summary_of_card),
    "sensors": _sensors,
    "gas_models": partial(_kinds_at, "gas", "GAS_KINDS"),
    "wind_solvers": partial(_kinds_at, "wind", "WIND_KINDS"),
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
        headings = [heading for heading in rows[0] if heading not in _HIDDEN] if rows else ["name"]
        write(table([h.replace("_", " ") for h in headings], [[row[h] for h in headings] for row in rows]))
        if arguments.kind is not None:
            _write_settings(rows)
    return 0


# One table per kind; settings that several kinds share are repeated for each.
def _write_settings(rows: list[Row]) -> None:
    for row in rows:
        settings = [[each["key"], each["unit"], each["default"], each["meaning"]] for each in row.get("settings", ())]
        if settings:
            write(f"\n{row['name'].upper()}")
            write(table(["setting", "unit", "default", "meaning"], settings))


COMMAND = Command(
    name="list",
    summary="list scenarios, agents, sensors, gas models, wind solvers, vehicles, gases or layouts",
    examples=EXAMPLES,
    add_arguments=_add_arguments,
    run=_run,
)
