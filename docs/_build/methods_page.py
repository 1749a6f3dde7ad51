"""Page docs/methods.md from the method cards: `python docs/_build/methods_page.py agents docs`."""

import json
import re
import sys
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, cast

import yaml

from gslcosim.base.yaml_core import CoreLoader
from gslcosim.methods.card import CARD_FILE, FAMILIES, MethodCard, Parameter, load_card

PAGE = "methods.md"
COSTS = "studies/method_costs.json"
PICTURES = "images/methods"
_WORDS = {
    "anchor": "Anchors",
    "reactive": "Reactive",
    "swarm": "Swarms and formations",
    "bayesian": "Bayesian",
    "information": "Information-driven",
    "map": "Maps",
    "learned": "Learned and planned",
    "vision": "Vision",
}

_HEAD = (
    "# Search methods\n\n"
    "<!-- Made by `make docs` from the method cards, agents/*/method.yaml; do not edit. -->\n\n"
    "Each method is a folder in `agents/`, flown by its name, `start: {python: surge_cast}`, and set by `parameters` "
    "in the scenario.\n"
    "`gslcosim validate` tells what a method needs and lacks, before anything flies.\n"
    "[write-an-agent.md](write-an-agent.md) has the way to one of your own, [search.md](search.md) the building "
    "blocks; policies of other packages fly through [adapters](examples/adapters/README.md).\n\n"
    "Sensors are kinds: *gas* any nose at a point, *gas_ppm* one that tells a mixing ratio (or a MOX sensor with its "
    "estimate), *gas_ohm* a MOX sensor, *wind* an anemometer, *range* range finders.\n"
    "*Knows* is what the scenario must grant with `knows`.\n"
    "*D* is 2 for a search in the plane at the search height, 3 for one in space.\n"
    "*Declares*: it has a rule by which it says where the source is. "
    "*Believes*: it publishes a probability for each place.\n"
)
_COST_NOTE = (
    "*Cost* is the processor time of a decision with the observations since the one before it, 95th percentile beside "
    "the limit [ms]; `{command}` measures it ({machine}).\n"
)
_TAGS = (
    "Where a parameter's value comes from: [C] read in public code or in a thesis; [A] in an abstract; [M] remembered, "
    "unverified; [R] computed for this project; ours: chosen here.\n\n"
    "The pictures show one and the same case, made by `docs/studies/draw_method_tracks.py`: shades are gas at the end "
    "of the flight, at the height of search; lines are tracks, from the dots on; the cross is the source, a ring a "
    "declaration.\n"
)


@dataclass(frozen=True, kw_only=True)
class Method:
    """A bundled method: the name of its folder, its card, what a decision costs [ms], and other languages' folders."""

    name: str
    card: MethodCard
    p95_ms: float | None = None
    ports: dict[str, str] = field(default_factory=dict[str, str])


def find_methods(agents: Path, costs: Mapping[str, Any]) -> list[Method]:
    """Return all methods of a folder of agents, by family and then by title.

    Args:
        agents: The folder; a method is a folder in it with a card and a program.
        costs: The content of `method_costs.json`, or nothing.
    """
    paths = [path for path in sorted(agents.glob(f"*/{CARD_FILE}")) if path.with_name("agent.py").is_file()]
    found = [
        Method(
            name=path.parent.name,
            card=load_card(path),
            p95_ms=costs.get("methods", {}).get(path.parent.name, {}).get("p95_ms"),
            ports=_ports_of(path.parent),
        )
        for path in paths
    ]
    return sorted(found, key=lambda method: (FAMILIES.index(method.card.family), method.card.title))


def build_methods_page(agents: Path, docs: Path) -> str:
    """Return the text of docs/methods.md."""
    costs = load_costs(docs)
    methods = find_methods(agents, costs)
    note = _COST_NOTE.format(command=costs["command"], machine=costs["machine"]) if costs else ""
    parts = [_HEAD + note, _table(methods), _TAGS]
    for family in FAMILIES:
        of_family = [method for method in methods if method.card.family == family]
        if of_family:
            parts += [f"## {_WORDS[family]}\n", *map(_section, of_family)]
    return "\n".join(parts).rstrip("\n") + "\n"


def load_costs(docs: Path) -> dict[str, Any]:
    """Return what `make bench-methods` has saved, nothing where it has not."""
    path = docs / COSTS
    return json.loads(path.read_text(encoding="utf-8")) if path.is_file() else {}


def _table(methods: list[Method]) -> str:
    head = "| method | family | paper | sensors | knows | D | robots | declares | believes | cost / limit |"
    return "\n".join([head, "|---|---|---|---|---|---|---|---|---|---|", *map(_row, methods), ""])


def _row(method: Method) -> str:
    card = method.card
    cost = "" if method.p95_ms is None else f"{method.p95_ms:g} / {card.decision_limit_ms:g}"
    cells = (
        f"[{card.title}](#{method.name})",
        card.family,
        _short_paper(card.paper),
        _sensors(card),
        ", ".join(card.needs.knows),
        f"{card.dimensions}",
        _robots(card),
        "yes" if card.declares else "",
        "yes" if card.believes else "",
        cost,
    )
    return "| " + " | ".join(map(_cell, cells)) + " |"


def _section(method: Method) -> str:
    card = method.card
    needs = ", ".join(filter(None, (_sensors(card), "radio" if card.needs.radio else "", *card.needs.knows)))
    ports = ", ".join(f"[{language}](../agents/{folder}/README.md)" for folder, language in method.ports.items())
    lines = [
        f"### {method.name}\n",
        f"![Track of {card.title}]({PICTURES}/{method.name}.png)\n",
        f"**{card.title}.** {card.summary}",
        f"Rules, deviations and known weaknesses: [agents/{method.name}](../agents/{method.name}/README.md).",
        *([f"Also in {ports}."] if ports else []),
        "",
        f"Paper: {card.paper}.".replace("..", "."),
        f"Needs: {needs or 'nothing'}; robots: {_robots(card)}.",
        "",
        *_parameters(card.parameters),
    ]
    return "\n".join(lines)


def _parameters(parameters: Mapping[str, Parameter]) -> list[str]:
    if not parameters:
        return ["It has no parameters.\n"]
    rows = [
        "| "
        + " | ".join(
            _cell(text)
            for text in (
                f"`{name}`", _value(parameter.default), _allowed(parameter), parameter.meaning, parameter.origin
            )
        )
        + " |"
        for name, parameter in parameters.items()
    ]  # fmt: skip
    return ["| parameter | default | allowed | meaning | from |", "|---|---|---|---|---|", *rows, ""]


def _allowed(parameter: Parameter) -> str:
    unit = "" if parameter.unit == "1" else f" {parameter.unit}"
    if parameter.choices:
        return ", ".join(map(_value, parameter.choices)) + unit
    low, high = (None if bound is None else f"{bound:g}" for bound in (parameter.min, parameter.max))
    if low is not None and high is not None:
        return f"{low} to {high}{unit}"
    if low is not None or high is not None:
        return (f"from {low}" if low is not None else f"up to {high}") + unit
    return {"bool": "true, false", "text": "text"}.get(parameter.kind, "any") + unit


def _value(value: object) -> str:
    if value is None:
        return "null"
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, float):
        return f"{value:g}"
    if isinstance(value, tuple):
        return "[" + ", ".join(map(_value, cast(tuple[object, ...], value))) + "]"
    return f"{value}" or '""'


def _sensors(card: MethodCard) -> str:
    return ", ".join(kind if n == 1 else f"{n} {kind}" for kind, n in card.needs.sensors.items())


def _robots(card: MethodCard) -> str:
    return f"{card.robots[0]} to {card.robots[1]}" if isinstance(card.robots, tuple) else f"{card.robots}"


# Up to the first year: `Pang, Farrell 2006`.
def _short_paper(paper: str) -> str:
    found = re.match(r"[^;:(]*?\b(?:19|20)\d\d\b", paper)
    return found[0] if found else re.split(r"[;(,]", paper)[0].strip()


def _cell(text: str) -> str:
    return text.replace("|", "\\|").replace("\n", " ")


# Folders of other languages say which methods they have, or are named after theirs.
def _ports_of(folder: Path) -> dict[str, str]:
    ports: dict[str, str] = {}
    for path in sorted(folder.parent.glob("*/agent.yaml")):
        fields = yaml.load(path.read_text(encoding="utf-8"), Loader=CoreLoader)
        port = path.parent.name
        if folder.name in fields.get("methods", ()) or port.startswith(f"{folder.name}_"):
            ports[port] = str(fields["language"])
    return ports


if __name__ == "__main__":
    agents_dir, docs_dir = map(Path, sys.argv[1:])
    (docs_dir / PAGE).write_text(build_methods_page(agents_dir, docs_dir), encoding="utf-8")
