"""Pages docs/methods.md and docs/methods/*.md from the method cards: `python docs/_build/methods_page.py agents docs`."""

import json
import re
import sys
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import Any, cast

import yaml

from gslcosim.base.bundled import AGENT_FILE
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

_NOTE = "<!-- Made by `make docs` from the method cards, agents/*/method.yaml; do not edit. -->"
_HEAD = f"""# Search methods

{_NOTE}

Each method is a folder in `agents/`.
A scenario starts it by name, `start: {{python: surge_cast}}`, and sets it by `parameters`.
`gslcosim validate` reports what a scenario lacks for its methods.

- Your own method: [write-an-agent.md](write-an-agent.md), with the building blocks in [search.md](search.md).
- Policies of other packages: [adapters](examples/adapters/README.md).
- Measured comparison of the methods: [studies/methods.md](studies/methods.md).
"""
_LEGEND = """## Legend

| column | meaning |
|---|---|
| sensors | *gas*: any gas sensor at a point; *gas_ppm*: one that measures a mixing ratio, or a MOX sensor with its estimate; *gas_ohm*: a MOX sensor; *wind*: an anemometer; *range*: range finders |
| knows | prior knowledge that the scenario must grant with `knows` |
| D | 2: searches in the plane at the search height; 3: searches in space |
| robots | number of robots |
| declares | declares the position of the source |
| believes | publishes a probability for each cell |
"""  # noqa: E501
_COST_NOTE = (
    "| cost / limit | processor time per decision, with the observations since the previous one: 95th percentile and "
    "limit [ms]; `{command}` measures it ({machine}) |\n"
)
_TAGS = (
    "The column *from* gives the source of a default: [C] public code or a thesis; [A] an abstract; [M] memory, "
    "unverified; [R] computed for this project; ours: chosen here.\n\n"
    "All pictures show the same case (`docs/studies/draw_method_tracks.py`). Shades: gas at the end of the run, at the "
    "search height. Lines: tracks, from the dots on. Cross: source. Ring: declaration.\n"
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
    cards = {path: load_card(path) for path in sorted(agents.glob(f"*/{CARD_FILE}"))}
    found = [
        Method(
            name=path.parent.name,
            card=card,
            p95_ms=costs.get("methods", {}).get(path.parent.name, {}).get("p95_ms"),
            ports=_ports_of(path.parent),
        )
        for path, card in cards.items()
        if card.program is not None or path.with_name(AGENT_FILE).is_file()
    ]
    return sorted(found, key=lambda method: (FAMILIES.index(method.card.family), method.card.title))


def build_methods_pages(agents: Path, docs: Path) -> dict[str, str]:
    """Return the pages by their paths in docs: methods.md with a table for each family, and a page for each family."""
    costs = load_costs(docs)
    methods = find_methods(agents, costs)
    note = _COST_NOTE.format(command=costs["command"], machine=costs["machine"]) if costs else ""
    tables, pages = list[str](), dict[str, str]()
    for family in FAMILIES:
        of_family = [method for method in methods if method.card.family == family]
        if of_family:
            tables += [f"## {_WORDS[family]}\n", _table(of_family)]
            head = f"# {_WORDS[family]}\n\n{_NOTE}\n\n[methods.md](../methods.md) compares all methods.\n{_TAGS}"
            pages[f"methods/{family}.md"] = _join([head, *map(_section, of_family)])
    return {PAGE: _join([_HEAD, *tables, _LEGEND + note]), **pages}


def _join(parts: list[str]) -> str:
    return "\n".join(parts).rstrip("\n") + "\n"


def load_costs(docs: Path) -> dict[str, Any]:
    """Return what `make bench-methods` has saved, nothing where it has not."""
    path = docs / COSTS
    return json.loads(path.read_text(encoding="utf-8")) if path.is_file() else {}


def _table(methods: list[Method]) -> str:
    head = "| method | search | sensors | knows | D | robots | declares | believes | cost / limit |"
    return "\n".join([head, "|---|---|---|---|---|---|---|---|---|", *map(_row, methods), ""])


def _row(method: Method) -> str:
    card = method.card
    cost = "" if method.p95_ms is None else f"{method.p95_ms:g} / {card.decision_limit_ms:g}"
    cells = (
        f"[{card.title}](methods/{card.family}.md#{method.name})",
        _first_sentence(card.summary),
        _sensors(card),
        ", ".join(card.needs.knows),
        f"{card.dimensions}",
        _robots(card),
        "yes" if card.declares else "",
        "yes" if card.believes else "",
        cost,
    )
    return "| " + " | ".join(map(_cell, cells)) + " |"


def _first_sentence(text: str) -> str:
    return re.split(r"(?<=[a-z0-9)][.]) ", " ".join(text.split()))[0].rstrip(".")


def _section(method: Method) -> str:
    card = method.card
    needs = ", ".join(filter(None, (_sensors(card), "radio" if card.needs.radio else "", *card.needs.knows)))
    ports = ", ".join(f"[{language}](../../agents/{folder}/README.md)" for folder, language in method.ports.items())
    lines = [
        f"## {method.name}\n",
        f"![Track of {card.title}](../{PICTURES}/{method.name}.png)\n",
        f"**{card.title}.** {card.summary}",
        "",
        f"- Paper: {card.paper}.".replace("..", "."),
        f"- Needs: {needs or 'nothing'}; robots: {_robots(card)}.",
        f"- Rules, deviations and known weaknesses: [agents/{method.name}](../../agents/{method.name}/README.md).",
        *([f"- Also in {ports}."] if ports else []),
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


def _cell(text: str) -> str:
    return text.replace("|", "\\|").replace("\n", " ")


# Folders of other languages list their methods, or are named after theirs.
def _ports_of(folder: Path) -> dict[str, str]:
    return {
        port: str(fields["language"])
        for port, fields in _programs_in(folder.parent).items()
        if folder.name in fields.get("methods", ()) or port.startswith(f"{folder.name}_")
    }


@cache
def _programs_in(agents: Path) -> dict[str, Any]:
    return {
        path.parent.name: yaml.load(path.read_text(encoding="utf-8"), Loader=CoreLoader)
        for path in sorted(agents.glob("*/agent.yaml"))
    }


if __name__ == "__main__":
    agents_dir, docs_dir = map(Path, sys.argv[1:])
    for name, text in build_methods_pages(agents_dir, docs_dir).items():
        (docs_dir / name).parent.mkdir(exist_ok=True)
        (docs_dir / name).write_text(text, encoding="utf-8")
