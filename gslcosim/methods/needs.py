"""Check of a method's needs: sensors of the vehicle, granted knowledge and parameters."""

from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass
from difflib import get_close_matches
from typing import Any

from gslcosim.contract.messages import SensorDescription
from gslcosim.methods.card import MethodCard
from gslcosim.methods.instrument_kinds import INSTRUMENT_KINDS, count_instruments


@dataclass(frozen=True, kw_only=True)
class UnmetNeed:
    """Something that a method lacks, or a parameter that is wrong; `part` is its place under the agent's block."""

    part: str
    expected: str
    found: str
    remedy: str

    def __str__(self) -> str:
        return f"{self.part}: expected {self.expected}, was {self.found}. {self.remedy}"


def find_unmet_needs(
    card: MethodCard,
    *,
    sensors: Iterable[SensorDescription],
    knows: Collection[str],
    n_channels: int,
    parameters: Mapping[str, Any],
) -> list[UnmetNeed]:
    """Return all that keeps a method from flying.

    Args:
        card: The method's.
        sensors: The instruments of the vehicle, as described in a briefing.
        knows: What is granted: `map`, `plume`, `source`.
        n_channels: The radio channels on which the agent is.
        parameters: The scenario's settings for it.
    """
    sensors = tuple(sensors)
    return [
        *_missing_sensors(card, sensors),
        *_missing_grants(card, knows),
        *_missing_radio(card, n_channels),
        *_wrong_parameters(card, parameters),
    ]


def _missing_sensors(card: MethodCard, sensors: tuple[SensorDescription, ...]) -> Iterable[UnmetNeed]:
    for kind, n_needed in card.needs.sensors.items():
        n_found = count_instruments(kind, sensors)
        if n_found < n_needed:
            yield UnmetNeed(
                part="sensors",
                expected=f"at least {n_needed} of kind {kind} for {card.title}",
                found=f"{n_found} ({', '.join(sensor.model for sensor in sensors) or 'no sensors'})",
                remedy=f"Add for example {INSTRUMENT_KINDS[kind][1]}.",
            )


def _missing_grants(card: MethodCard, knows: Collection[str]) -> Iterable[UnmetNeed]:
    for item in card.needs.knows:
        if item not in knows:
            yield UnmetNeed(
                part="knows",
                expected=f"{item}: true for {card.title}",
                found="not granted",
                remedy=f"Add knows: {{{item}: true}} to the agent.",
            )


def _missing_radio(card: MethodCard, n_channels: int) -> Iterable[UnmetNeed]:
    if card.needs.radio and not n_channels:
        yield UnmetNeed(
            part="name",
            expected=f"an agent on a radio channel for {card.title}",
            found="one without",
            remedy="Add for example channels: [{name: radio}] to the scenario.",
        )


def _wrong_parameters(card: MethodCard, parameters: Mapping[str, Any]) -> Iterable[UnmetNeed]:
    for name, value in parameters.items():
        parameter = card.parameters.get(name)
        if parameter is None:
            known = ", ".join(card.parameters) or "none"
            nearest = get_close_matches(name, card.parameters, n=1)
            hint = f"Did you mean {nearest[0]}?" if nearest else "Leave it out."
            yield UnmetNeed(
                part=f"parameters.{name}",
                expected=f"a parameter of {card.title} ({known})",
                found=f"'{name}'",
                remedy=hint,
            )
        elif expected := parameter.problem_of(value):
            yield UnmetNeed(
                part=f"parameters.{name}",
                expected=expected,
                found=f"{value!r}" if isinstance(value, str) else f"{value}",
                remedy=f"Its default is {parameter.default}.",
            )
