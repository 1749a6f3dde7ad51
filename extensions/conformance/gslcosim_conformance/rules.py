"""Rules that every agent and every participant keeps, and the report of a check: one finding for each rule."""

import textwrap
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import Any, Literal

import yaml
from pydantic import TypeAdapter

TransportScope = Literal["all", "zenoh", "gateway"]
Stage = Literal["opening", "session", "any", "end", "later"]
Variation = Literal[
    "plain", "unknown fields", "optional fields", "missing inputs", "repeats", "ending at once", "lost link"
]
Status = Literal["passed", "failed", "not_judged", "not_applicable"]
_MARKS: Mapping[Status, str] = {"passed": "PASS", "failed": "FAIL", "not_judged": " -- ", "not_applicable": " n/a"}
_WIDTH = 110
_INDENT = " " * 16


@dataclass(frozen=True, kw_only=True)
class Rule:
    """One rule.

    `id` is short and stable; `sentence` says what a right agent does; `remedy` is what the author of a wrong one does
    next; `transports` are those through which the rule has a meaning.

    How a check judges it: `stage` is when, in the first session or in later ones ("any" is judged however far the first
    came). Where a rule that `stops` is broken, the rest of the check would only repeat it in other words; one that
    `needs_answers` says nothing of a program that gave none. It is not judged where a rule in `after` is broken.
    `variation` is what is special in the rule's own session; its answers are those of the first session, although it
    differs in `change`, where that is not None.
    """

    id: str
    sentence: str
    remedy: str
    transports: TransportScope = "all"
    stage: Stage = "session"
    stops: bool = False
    needs_answers: bool = False
    variation: Variation = "plain"
    change: str | None = None
    after: tuple[str, ...] = ()

    def applies_to(self, transport: str) -> bool:
        """Return whether the rule has a meaning for agents behind a transport."""
        return self.transports == "all" or (self.transports == "zenoh") == (transport == "zenoh")


def _load_rules() -> dict[str, dict[str, Rule]]:
    table = yaml.safe_load(Path(__file__).with_suffix(".yaml").read_text(encoding="utf-8"))
    found = TypeAdapter(dict[str, tuple[Rule, ...]]).validate_python(table)
    return {name: {rule.id: rule for rule in rules} for name, rules in found.items()}


_TABLE = _load_rules()
RULES = _TABLE["agent"]
PARTICIPANT_RULES = _TABLE["participant"]


@dataclass(frozen=True, kw_only=True)
class Failure:
    """One break of a rule: in which run, what was sent to the agent, what was expected of it, and what came.

    `remedy` is what to change, where more is known than what the rule says of all its breaks.
    """

    rule: str
    flight: str
    sent: str
    expected: str
    got: str
    remedy: str = ""


@dataclass(frozen=True, kw_only=True)
class Finding:
    """Finding on one rule; `note` says why it was not judged, or something worth knowing."""

    rule: Rule
    status: Status
    failure: Failure | None = None
    note: str = ""

    def as_fields(self) -> dict[str, Any]:
        """Return the finding as JSON has it."""
        fields: dict[str, Any] = {"id": self.rule.id, "sentence": self.rule.sentence, "status": self.status}
        if self.failure is not None:
            fields |= {name: value for name, value in vars(self.failure).items() if name != "rule"}
            fields["remedy"] = self.failure.remedy or self.rule.remedy
        if self.note:
            fields["note"] = self.note
        return fields

    def as_lines(self) -> list[str]:
        """Return the finding as people read it."""
        lines = [f"{_MARKS[self.status]}  {self.rule.id:<16}  {self.rule.sentence}"]
        if self.note:
            lines[0] += f" ({self.note})"
        if self.failure is not None:
            parts = {**vars(self.failure), "remedy": self.failure.remedy or self.rule.remedy}
            for name in ("flight", "sent", "expected", "got", "remedy"):
                lines += _wrap(f"      {name:<10}", str(parts[name]))
        return lines


@dataclass(frozen=True, kw_only=True)
class CheckReport:
    """All findings about one agent, in the order of the rules, and what else was seen."""

    command: tuple[str, ...]
    transport: str
    format: str
    findings: tuple[Finding, ...]
    notes: tuple[str, ...] = ()

    @property
    def has_passed(self) -> bool:
        """True when no rule is broken and none had to be left unjudged."""
        return all(finding.status in ("passed", "not_applicable") for finding in self.findings)

    @property
    def failed_rules(self) -> tuple[str, ...]:
        """The ids of the broken rules."""
        return tuple(finding.rule.id for finding in self.findings if finding.status == "failed")

    def finding(self, rule_id: str) -> Finding:
        """Return the finding about a rule."""
        return next(finding for finding in self.findings if finding.rule.id == rule_id)

    def as_fields(self) -> dict[str, Any]:
        """Return the report as `--json` prints it."""
        return {
            "passed": self.has_passed,
            "command": list(self.command),
            "door": self.transport,
            "format": self.format,
            "rules": [finding.as_fields() for finding in self.findings],
            "notes": list(self.notes),
        }

    def as_text(self) -> str:
        """Return the report as people read it."""
        lines = [line for finding in self.findings for line in finding.as_lines()]
        counts = [sum(finding.status == status for finding in self.findings) for status in ("passed", "failed")]
        n_open = sum(finding.status == "not_judged" for finding in self.findings)
        verdict = f"{counts[0]} rules passed, {counts[1]} failed" + (f", {n_open} not judged" if n_open else "")
        return "\n".join([*lines, "", *self.notes, f"{verdict}."])


def build_findings(
    transport: str,
    failures: Mapping[str, Failure],
    unjudged: Mapping[str, str],
    notes: Mapping[str, str],
    beyond: Mapping[str, str] = MappingProxyType({}),
    *,
    rules: Mapping[str, Rule] = RULES,
) -> tuple[Finding, ...]:
    """Return one finding for each rule.

    Args:
        transport: The agent's transport; rules of other transports do not apply.
        unjudged: Why a rule was not judged, by rule; a break goes first.
        notes: Worth knowing about a rule that was kept.
        beyond: Why a rule cannot be judged on this machine at all, by rule.
        rules: All rules, by id; those of agents by default.
    """
    return tuple(
        Finding(rule=rule, status="not_applicable", note=beyond[rule.id])
        if rule.id in beyond
        else _build_finding(rule, transport, failures, unjudged, notes)
        for rule in rules.values()
    )


def _build_finding(
    rule: Rule, transport: str, failures: Mapping[str, Failure], unjudged: Mapping[str, str], notes: Mapping[str, str]
) -> Finding:
    if not rule.applies_to(transport):
        return Finding(rule=rule, status="not_applicable", note=f"not for the transport {transport}")
    if rule.id in failures:
        return Finding(rule=rule, status="failed", failure=failures[rule.id])
    if rule.id in unjudged:
        return Finding(rule=rule, status="not_judged", note=unjudged[rule.id])
    return Finding(rule=rule, status="passed", note=notes.get(rule.id, ""))


def _wrap(label: str, text: str) -> list[str]:
    paragraphs = text.splitlines() or [""]
    lines = [line for part in paragraphs for line in (textwrap.wrap(part, _WIDTH - len(_INDENT)) or [""])]
    return [f"{label if i == 0 else _INDENT}{line}".rstrip() for i, line in enumerate(lines)]
