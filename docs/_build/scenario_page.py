"""Page of all keys of a scenario, made from the models: `make docs` writes docs/scenario.md."""

import inspect
import sys
import typing
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from pydantic import BaseModel
from pydantic.fields import FieldInfo

from gslcosim.scenario.checks.cross_checks import MAX_NUMBER
from gslcosim.scenario.loader import MAX_BYTES
from gslcosim.scenario.model_schema import (
    SchemaNode,
    default_text,
    field_annotation,
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

_HEAD = """# Scenario files

<!-- Made by `make docs` from gslcosim/scenario/models; do not edit. -->

A scenario is one YAML file.
`gslcosim validate FILE` lists all its problems, each with its line; `--resolved` prints it with all defaults.
This page has every key. Start with this complete scenario:

"""
_EXAMPLE = "scenarios/tiny_room.yaml"
_FORMAT = f"""## Reading the tables

- `[]` in a key stands for each item of a list.
- *with* lists the kinds of block that have the key; an empty cell means all kinds.
- *default* is `required` for keys that you must set, and `absent` for keys without a value.
- Packages can add kinds: `gslcosim list` shows them, and [services](extend/service.md).

## File format

- The file is UTF-8, with Unix or Windows line ends; a byte order mark is ignored.
- Values follow the core schema of YAML 1.2: `yes`, `on` and `12:30` are texts, `1e-3` is a number.
  Other tags are errors.
- Unknown and duplicate keys are errors, and so are keys that the kind of a block does not have.
- Numbers are finite. The name of a key ends with its unit; do not write units after numbers. Integers have no point.
- Paths are relative to the scenario's folder; in `--set`, to the working directory.
- Limits: {MAX_BYTES / 1e6:g} MB per file, {MAX_LEVELS} nested levels, {MAX_VALUES} values (repeated aliases count),
  numbers up to {MAX_NUMBER:g}.
"""
# Pages with more about a block.
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
    sections = list(iterate_sections(BlockSection(path="", kinds={"": Scenario})))
    return "\n".join([_HEAD + _example(), _index(sections), _FORMAT, *map(_text_of_section, sections)])


def _example() -> str:
    program = (Path(__file__).parents[2] / _EXAMPLE).read_text(encoding="utf-8")
    return f"<!-- from {_EXAMPLE} -->\n```yaml\n{program}```\n"


# A line for each block of the file, with the blocks inside it.
def _index(sections: list[BlockSection]) -> str:
    rows = ["## Blocks\n", "| block | contents | blocks inside | guide |", "|---|---|---|---|"]
    meanings = {row.path: row.meaning for row in section_rows(sections[0])}
    for key, meaning in meanings.items():
        inner = [each.path for each in sections if each.path.startswith((f"{key}.", f"{key}["))]
        own = next((each.path for each in sections if each.path in (key, f"{key}[]")), None)
        if own is None:
            continue
        links = ", ".join(f"[{path.removeprefix(own).lstrip('.')}](#{_anchor(path)})" for path in inner if path != own)
        page = _PAGES.get(own, "")
        rows.append(f"| [{own}](#{_anchor(own)}) | {meaning} | {links} | {f'[{page}]({page})' if page else ''} |")
    return "\n".join([*rows, ""])


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
    head = ["key", "value", "unit", "default", *([] if is_one else ["with"]), "meaning"]
    cells = [
        [f"`{row.path}`", row.allowed, row.unit, row.default, *([] if is_one else [_with(has, kinds)]), row.meaning]
        for row, has in ranked
    ]
    lines = [f"| {' | '.join(row)} |" for row in (head, *cells)]
    lines.insert(1, f"|{'---|' * len(head)}")
    return "\n".join([f"## {section.path or 'The whole file'}\n", *_prose(section), *lines, ""])


# One or two blocks describe their kinds; where there are more, other pages do.
def _prose(section: BlockSection) -> Iterator[str]:
    blocks = dict.fromkeys(section.kinds.values())
    if len(blocks) == 1 or (len(blocks) == 2 and len(section.kinds) > 2):
        yield from (f"{inspect.cleandoc(block.__doc__ or '')}\n" for block in blocks)
    if section.path in _PAGES:
        yield f"Guide: [{_PAGES[section.path]}]({_PAGES[section.path]}).\n"


# A block some of whose keys belong to some kinds only is as good as a block for each kind.
def _kinds_in(section: BlockSection) -> Mapping[str, type[BaseModel]]:
    block = section.kinds.get("")
    if block is None or not issubclass(block, KindedSpec) or not block.belongs:
        return section.kinds
    words = typing.get_args(block.model_fields[block.tag_key].annotation)
    return {str(word): block for word in words}


# Its own words, or those of the block that it derives from.
def _meaning_of(block: type[BaseModel], name: str) -> str:
    bases = (base for base in block.__mro__ if issubclass(base, BaseModel) and name in base.model_fields)
    return next((text for base in bases if (text := base.model_fields[name].description)), "")


def _row(section: BlockSection, block: type[BaseModel], name: str, kind: str) -> KeyRow:
    field = block.model_fields[name]
    path = child_path(section.path, field.alias or name)
    allowed, default = _allowed(path, field, kind), default_text(field)
    if name == section.tag_key and block.model_fields[name].annotation is not Any and len(section.kinds) > 1:
        is_said = len({*section.kinds.values()}) == 1
        allowed = allowed if is_said else f"one of {', '.join(section.kinds)}"
        default = section.default_kind or "required"
    return KeyRow(path=path, allowed=allowed, unit=unit_text(name), default=default, meaning=_meaning_of(block, name))


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
