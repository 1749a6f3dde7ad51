"""Parameter values as they are typed: lists to sweep and ranges to search, checked against the method's card."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import yaml

from gslcosim.base.errors import UsageError
from gslcosim.base.yaml_core import CoreLoader
from gslcosim.bench.studies.target import StudyTarget
from gslcosim.contract.messages import ParameterValue
from gslcosim.methods.card import MethodCard, Parameter
from gslcosim.methods.needs import find_unmet_needs

_PART = "parameters."
_DIGITS = 4


@dataclass(frozen=True, kw_only=True)
class ParameterRange:
    """From where to where a number is searched, in its unit; `is_log`: in equal factors instead of equal steps."""

    name: str
    low: float
    high: float
    is_whole: bool = False
    is_log: bool = False

    def __str__(self) -> str:
        return f"{self.name}={self.low:g}:{self.high:g}{':log' if self.is_log else ''}"

    def holds(self, value: object) -> bool:
        """Return whether a value is a number within the range."""
        return isinstance(value, int | float) and not isinstance(value, bool) and self.low <= value <= self.high

    def rounded(self, value: float) -> int | float:
        """Return a value as it is run: with four digits, so that it can be read and typed."""
        if self.is_whole:
            return round(value)
        return min(max(float(f"{value:.{_DIGITS}g}"), self.low), self.high)


def parse_varied(texts: Sequence[str], subject: StudyTarget) -> dict[str, tuple[ParameterValue, ...]]:
    """Return the values of each parameter of texts such as `step_m=0.2,0.5,1.0`.

    Raises:
        UsageError: a text is no such list, or the method's card allows no such parameter or value.
    """
    varied: dict[str, tuple[ParameterValue, ...]] = {}
    for text in texts:
        name, equals, listed = text.partition("=")
        values = _listed(listed) if equals and name else ()
        if not values:
            raise UsageError(
                f"--vary: expected PARAMETER=VALUE,VALUE and so on, was '{text}'. "
                "For example: --vary step_m=0.2,0.5,1.0"
            )
        if name in varied:
            raise UsageError(f"--vary: expected each parameter once, was {name} twice. Put its values into one list.")
        values = tuple(check_value("--vary", name, value, subject.card) for value in values)
        if twice := [value for i, value in enumerate(values) if value in values[:i]]:
            raise UsageError(f"--vary {name}: expected each value once, was {twice[0]} twice. Leave one out.")
        varied[name] = values
    return varied


def parse_ranges(texts: Sequence[str], subject: StudyTarget) -> tuple[ParameterRange, ...]:
    """Return the ranges of texts such as `step_m=0.1:2.0` or `step_m=0.1:2.0:log`.

    Raises:
        UsageError: a text is no such range, or the method's card does not allow all of it.
    """
    ranges = [_range(text, subject.card) for text in texts]
    names = [each.name for each in ranges]
    if twice := next((name for name in names if names.count(name) > 1), None):
        raise UsageError(f"--range: expected each parameter once, was {twice} twice. Leave one out.")
    return tuple(ranges)


def card_ranges(subject: StudyTarget) -> tuple[ParameterRange, ...]:
    """Return the ranges of all numbers on a card that have a least, a most and a default.

    A number whose default is null is left to the scenario, and is no part of the method unless it is named.

    Raises:
        UsageError: there are none, or there is no card.
    """
    parameters = subject.card.parameters if subject.card is not None else {}
    ranges = tuple(
        ParameterRange(name=name, low=each.min, high=each.max, is_whole=each.kind == "int")
        for name, each in parameters.items()
        if each.kind in ("float", "int")
        and each.default is not None
        and each.min is not None
        and each.max is not None
        and each.min < each.max
    )
    if not ranges:
        raise UsageError(
            f"--range: expected ranges to search, for {subject.entry.name} has no card (method.yaml beside its "
            "program) with numbers that have min and max; was none. For example: --range step_m=0.1:2.0"
        )
    return ranges


def check_value(option: str, name: str, value: Any, card: MethodCard | None) -> Any:
    """Return a value as the method gets it; without a card everything is allowed.

    Raises:
        UsageError: the card has no such parameter, or does not allow the value.
    """
    if card is None:
        return tuple(value) if isinstance(value, list) else value
    shortages = find_unmet_needs(card, sensors=(), knows=(), n_channels=0, parameters={name: value})
    wrong = next((each for each in shortages if each.part.startswith(_PART)), None)
    if wrong is not None:
        raise UsageError(f"{option} {name}: expected {wrong.expected}, was {wrong.found}. {wrong.remedy}")
    return card.parameters[name].parsed(value)


def _listed(text: str) -> tuple[Any, ...]:
    try:
        values = yaml.load(f"[{text}]", Loader=CoreLoader)
    except yaml.YAMLError:
        return ()
    is_list = isinstance(values, list) and all(isinstance(v, bool | int | float | str | list) for v in values)
    return tuple(values) if is_list else ()


def _range(text: str, card: MethodCard | None) -> ParameterRange:
    name, equals, ends = text.partition("=")
    words = ends.split(":")
    is_log = len(words) == 3 and words[2] == "log"
    numbers = [_number(word) for word in words[:2]]
    if not equals or not name or len(words) not in (2, 3) or (len(words) == 3 and not is_log) or None in numbers:
        raise UsageError(
            f"--range: expected PARAMETER=LEAST:MOST, or with :log behind it, was '{text}'. "
            "For example: --range step_m=0.1:2.0"
        )
    low, high = (number for number in numbers if number is not None)
    parameter = _numeric("--range", name, (low, high), card)
    is_whole = parameter.kind == "int" if parameter is not None else isinstance(low, int) and isinstance(high, int)
    if not low < high or (is_log and low <= 0):
        wanted = "a least value above 0 for :log" if is_log and low <= 0 else "the least value before the most"
        raise UsageError(f"--range {name}: expected {wanted}, was {ends}. For example: --range {name}=0.1:2.0")
    return ParameterRange(name=name, low=low, high=high, is_whole=is_whole, is_log=is_log)


def _numeric(option: str, name: str, ends: tuple[float, float], card: MethodCard | None) -> Parameter | None:
    parameter = card.parameters.get(name) if card is not None else None
    if parameter is not None and (parameter.kind not in ("float", "int") or parameter.choices):
        raise UsageError(
            f"{option} {name}: expected a parameter that is a number, was one that is not. "
            f"Compare its values with: gslcosim sweep SUITE --entry NAME --vary {name}=..."
        )
    for end in ends:
        check_value(option, name, end, card)
    return parameter


def _number(word: str) -> int | float | None:
    try:
        value = yaml.load(word, Loader=CoreLoader)
    except yaml.YAMLError:
        return None
    is_number = isinstance(value, int | float) and not isinstance(value, bool) and abs(value) < float("inf")
    return value if is_number else None
