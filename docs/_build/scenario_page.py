"""Page of all keys of a scenario, made from the models: `make docs` writes docs/scenario.md."""

import inspect
import sys
import typing
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Any

from pydantic import BaseModel
from pydantic.fields import FieldInfo

from gslcosim.scenario.checks.cross_checks import MAX_NUMBER
from gslcosim.scenario.loader import MAX_BYTES
from gslcosim.scenario.model_schema import (
    SchemaNode,
    default_text,
    field_annotation,
    field_meaning,
    find_default_kind,
    find_model,
    find_tag_key,
    item_annotation,
    list_blocks,
    unit_text,
)
from gslcosim.scenario.models.base import KindedSpec
from gslcosim.scenario.models.scenario import Scenario
from gslcosim.scenario.models.sensors import mox_sensor_names
from gslcosim.scenario.problems import child_path
from gslcosim.scenario.serialization import MAX_LEVELS, MAX_VALUES

_HEAD = f"""# Scenario files

<!-- Made by `make docs` from gslcosim/scenario/models; do not edit. -->

A scenario is one YAML document.
`gslcosim validate FILE` tells all of its problems at once, each with its line.
With `--resolved` it prints the scenario with all defaults filled in.

- Values follow YAML 1.2's core schema: `yes`, `on` and `12:30` are texts, `1e-3` is a number.
  Other tags than its own are refused.
- The file is in UTF-8. A byte order mark is passed over, and lines may end as on Windows.
- Each key is there once; a second one is an error with both lines.
- Lists and blocks are at most {MAX_LEVELS} deep.
  There are at most {MAX_VALUES} values, counted where aliases repeat them.
- A file has at most {MAX_BYTES / 1e6:g} MB, and a number is at most {MAX_NUMBER:g} in size.
- Unknown keys are errors, and so is a key that means nothing with the kind of its block.
- Numbers are finite, and have the unit that their key's name ends with; units are never written behind them.
  Whole numbers have no point.
- Relative paths start at the scenario's folder; those given by `--set` at the working directory.

`[]` in a key stands for each item of a list.
In the column *with* are the kinds of block that have the key; where it is empty, all have it.
Packages bring kinds of their own, which `gslcosim list` shows, and [services](extend/service.md).
"""
# Where more is reported of a block.
_PAGES = {
    "environment": "environments.md",
    "environment.geometry": "own-geometry.md",
    "wind": "environments.md",
    "gas": "gas.md",
    "events[]": "events.md",
    "agents[]": "write-an-agent.md",
    "agents[].start": "gateway.md",
    "agents[].vehicle": "vehicles.md",
    "agents[].sensors[]": "sensors.md",
    "channels[]": "swarms.md",
    "referee.success": "success.md",
    "recording": "recordings.md",
}


@dataclass(frozen=True, kw_only=True)
class KeyRow:
    """Row of the page for a key: its whole path, what is allowed, its unit, its default and its meaning."""

    path: str
    allowed: str
    unit: str
    default: str
    meaning: str


@dataclass(frozen=True, kw_only=True)
class BlockSection:
    """A block of a scenario: its path, and the model of each kind of it; a block of one kind has the kind "".

    `tag_key` is the key that names the kind, `default_kind` that of a block without it; both are empty where the kind
    is that of the block around it, or there is but one.
    """

    path: str
    kinds: dict[str, type[BaseModel]]
    tag_key: str = ""
    default_kind: str = ""


def build_scenario_page() -> str:
    """Return the whole page."""
    return "\n".join([_HEAD, *map(_text_of_section, iterate_sections(BlockSection(path="", kinds={"": Scenario})))])


def iterate_sections(section: BlockSection) -> Iterator[BlockSection]:
    """Yield a section and those of the blocks within it, in the order of the file."""
    yield section
    inner: dict[str, BlockSection] = {}
    for kind, block in section.kinds.items():
        for name, field in block.model_fields.items():
            if found := _block_in(child_path(section.path, field.alias or name), field, kind):
                first = inner.setdefault(found.path, found)
                first.kinds.update(found.kinds)
    for each in inner.values():
        is_one = not each.tag_key and len({*each.kinds.values()}) == 1
        yield from iterate_sections(replace(each, kinds={"": next(iter(each.kinds.values()))}) if is_one else each)


def section_rows(section: BlockSection) -> dict[KeyRow, list[str]]:
    """Return the rows of a section, each with the kinds that have it."""
    kinds = _kinds_in(section)
    rows: dict[KeyRow, list[str]] = {}
    for kind, block in kinds.items():
        belongs: Mapping[str, tuple[str, ...]] = block.belongs if issubclass(block, KindedSpec) else {}
        for name, field in block.model_fields.items():
            key = field.alias or name
            if not kind or kind in belongs.get(key, (kind,)):
                rows.setdefault(_row(section, block, name, kind), []).append(kind)
    return rows


# The block, or list of blocks, that belongs to a key.
def _block_in(path: str, field: FieldInfo, kind: str) -> BlockSection | None:
    whole = field_annotation(field)
    for annotation, place in ((whole, path), (item_annotation(whole), f"{path}[]")):
        if kinds := list_blocks(annotation):
            default = find_default_kind(annotation) or ""
            return BlockSection(path=place, kinds=kinds, tag_key=find_tag_key(annotation), default_kind=default)
        if block := find_model(annotation):
            return BlockSection(path=place, kinds={kind: block})
    return None


def _text_of_section(section: BlockSection) -> str:
    rows, kinds = section_rows(section), _kinds_in(section)
    is_one = len(kinds) == 1
    # What all kinds have comes first.
    ranked = sorted(rows.items(), key=lambda item: len(item[1]) < len(kinds))
    head = ["key", "what is allowed", "unit", "default", *([] if is_one else ["with"]), "meaning"]
    cells = [
        [f"`{row.path}`", row.allowed, row.unit, row.default, *([] if is_one else [_with(has, kinds)]), row.meaning]
        for row, has in ranked
    ]
    lines = [f"| {' | '.join(row)} |" for row in (head, *cells)]
    lines.insert(1, f"|{'---|' * len(head)}")
    return "\n".join([f"## {section.path or 'The whole file'}\n", *_prose(section), *lines, ""])


def _prose(section: BlockSection) -> Iterator[str]:
    if len({*section.kinds.values()}) == 1:
        yield f"{inspect.cleandoc(next(iter(section.kinds.values())).__doc__ or '')}\n"
    if section.path in _PAGES:
        yield f"More in [{_PAGES[section.path]}]({_PAGES[section.path]}).\n"


# A block some of whose keys belong to some kinds only is as good as a block for each kind.
def _kinds_in(section: BlockSection) -> Mapping[str, type[BaseModel]]:
    block = section.kinds.get("")
    if block is None or not issubclass(block, KindedSpec) or not block.belongs:
        return section.kinds
    words = typing.get_args(block.model_fields[block.tag_key].annotation)
    return {str(word): block for word in words}


def _row(section: BlockSection, block: type[BaseModel], name: str, kind: str) -> KeyRow:
    field = block.model_fields[name]
    path = child_path(section.path, field.alias or name)
    allowed, default = _allowed(path, field, kind), default_text(field)
    if name == section.tag_key and block.model_fields[name].annotation is not Any and len(section.kinds) > 1:
        is_said = len({*section.kinds.values()}) == 1
        allowed = allowed if is_said else f"one of {', '.join(section.kinds)}"
        default = section.default_kind or "required"
    return KeyRow(path=path, allowed=allowed, unit=unit_text(name), default=default, meaning=field_meaning(block, name))


def _allowed(path: str, field: FieldInfo, kind: str) -> str:
    found = _block_in(path, field, kind)
    if found is None:
        slot = SchemaNode(path=path, key="", annotation=field.annotation, constraints=tuple(field.metadata))
        return slot.describe()
    what = "a list of blocks" if found.path.endswith("[]") else "a block"
    return f"{what}: [{found.path}](#{_anchor(found.path)})"


def _with(names: list[str], kinds: Mapping[str, object]) -> str:
    if len(names) == len(kinds):
        return ""
    mox = [name for name in mox_sensor_names() if name in kinds]
    if mox and {*mox} <= {*names}:
        names = ["MOX", *(name for name in names if name not in mox)]
    return ", ".join(names)


def _anchor(heading: str) -> str:
    return "".join(c for c in heading.lower() if c.isalnum() or c in " _-").replace(" ", "-")


if __name__ == "__main__":
    sys.stdout.write(build_scenario_page())
