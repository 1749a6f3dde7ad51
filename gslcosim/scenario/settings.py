"""Settings of a block as rows: key, unit, default and meaning, from its fields."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any, cast

from pydantic import BaseModel
from pydantic.fields import FieldInfo
from pydantic_core import PydanticUndefined

from gslcosim.scenario.model_schema import find_model, list_words
from gslcosim.scenario.models.one_of import KindedSpec
from gslcosim.scenario.units import unit_name


@dataclass(frozen=True, kw_only=True)
class SettingRow:
    """A setting of a block; the key of one inside a block of the block is written `plume.meander_s`."""

    key: str
    unit: str
    default: str
    meaning: str


def list_settings(
    block: type[BaseModel], *, kind: str | None = None, without: frozenset[str] = frozenset()
) -> list[SettingRow]:
    """Return the settings of a block in the order of its fields.

    Args:
        block: The block's class.
        kind: The kind, where several share the block: settings of the others are left out.
        without: Keys to leave out.
    """
    belongs: Mapping[str, tuple[str, ...]] = block.belongs if issubclass(block, KindedSpec) else {}
    foreign = {key for key, kinds in belongs.items() if kind is not None and kind not in kinds}
    return [each for each in _settings(block, "") if not {each.key, each.key.partition(".")[0]} & (without | foreign)]


def _settings(block: type[BaseModel], prefix: str) -> Iterator[SettingRow]:
    for name, field in block.model_fields.items():
        key = f"{prefix}{field.alias or name}"
        inner = find_model(field.annotation)
        if inner is not None:
            yield from _settings(inner, f"{key}.")
            continue
        yield SettingRow(key=key, unit=unit_text(name), default=default_text(field), meaning=_meaning(field))


def unit_text(name: str) -> str:
    """Return what a number under a key counts; empty where the key's name does not say it or only a part of it.

    An ending such as that of `hits_per_s_per_ppm` is a part of a unit only; the meaning says the rest.
    """
    return "" if "_per_" in name.removesuffix("_per_s") else unit_name(name)


def default_text(field: FieldInfo) -> str:
    """Return the default of a field as a scenario file has it, `required`, or in a word."""
    if field.default_factory is not None:
        return "see meaning"
    return "required" if field.default is PydanticUndefined else _shown(field.default)


def field_meaning(block: type[BaseModel], name: str) -> str:
    """Return what a field of a block means: its own words, or those of the block that it derives from."""
    bases = (base for base in block.__mro__ if issubclass(base, BaseModel) and name in base.model_fields)
    return next((text for base in bases if (text := base.model_fields[name].description)), "")


def _shown(value: Any) -> str:
    match value:
        case None:
            return "absent"
        case BaseModel():
            return "its defaults"
        case bool():
            return str(value).lower()
        case float():
            return f"{value:g}"
        case tuple():
            return f"[{', '.join(_shown(item) for item in cast('tuple[Any, ...]', value))}]"
        case _:
            return str(value)


def _meaning(field: FieldInfo) -> str:
    words = list_words(field.annotation)
    choice = f" ({', '.join(words)})" if len(words) > 1 else ""
    return f"{field.description or ''}{choice}".strip()
