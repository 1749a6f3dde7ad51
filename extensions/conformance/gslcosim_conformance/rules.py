"""Rules that every agent and every participant keeps, and the report of a check: one finding for each rule."""

import textwrap
from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any, Literal

TransportScope = Literal["all", "zenoh", "gateway"]
Stage = Literal["opening", "session", "any", "end", "later"]
Variation = Literal[
    "plain", "unknown fields", "optional fields", "missing inputs", "repeats", "ending at once", "lost link"
]


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


# Of agents and participants alike.
_ENDING_RULES = (
    Rule(
        id="ending",
        sentence="exits within 2 s after Ending",
        remedy="Leave the loop when Ending comes, and end threads that would keep the process alive.",
        stage="end",
    ),
    Rule(
        id="exit-code",
        sentence="exits with code 0 after Ending",
        remedy="Let the program return normally; another code says that it failed.",
        stage="end",
        after=("ending",),
    ),
)

_UNKNOWN_FIELDS = Rule(
    id="unknown-fields",
    sentence="ignores fields and a later minor version that it does not know",
    remedy="Read the fields you need by name and pass over the rest: later versions of the contract add some.",
    stage="later",
    variation="unknown fields",
    change=", with fields of a later minor version such as x_text and x_list",
)

# In the order in which a session meets them: the first broken rule is the one to look at first.
_AGENT_RULES = (
    Rule(
        id="joins",
        sentence="starts and joins the run in time",
        remedy="Run the command by itself and read its log. Over Zenoh an agent joins with the user, password "
        "and namespace of GSLCOSIM_JOIN and shows the liveliness token agents/<name>/alive; over tcp and unix it "
        "connects to GSLCOSIM_GATEWAY and sends the frame {token: GSLCOSIM_TOKEN} first.",
        stage="opening",
        stops=True,
    ),
    Rule(
        id="listens-first",
        sentence="subscribes to briefing, observation and ending before it shows its liveliness token",
        remedy="Declare the token last: what is published between token and subscription is lost.",
        transports="zenoh",
        stage="opening",
        stops=True,
    ),
    Rule(
        id="answers",
        sentence="answers each observation that awaits a command",
        remedy="Send one command whenever awaiting_command is true, and flush it: a buffered line is not sent.",
        stops=True,
    ),
    Rule(
        id="deadline",
        sentence="answers in time",
        remedy="Compute less for each decision, or raise answer_within_s in the scenario (--timeout here).",
        stops=True,
        needs_answers=True,
    ),
    Rule(
        id="size",
        sentence="sends commands of at most 1 MiB",
        remedy="Send the decision only; maps and logs belong into files of your own.",
        stops=True,
    ),
    Rule(
        id="encoding",
        sentence="sends each command as one msgpack map with texts as keys, or one JSON object on a line of its own",
        remedy="Pack a map (not a list, not a text, no numbers as keys), one a frame, in the --format you have chosen. "
        "Over stdio nothing else may be written to the standard output: notes go to the standard error.",
        stops=True,
    ),
    Rule(
        id="contract",
        sentence="says of its contract, if anything, what this gslcosim speaks",
        remedy="Build the agent with the contract that `gslcosim schema export` writes, or leave `contract` out.",
        stops=True,
        needs_answers=True,
    ),
    Rule(
        id="integers",
        sentence="sends whole numbers as integers",
        remedy="Send tick as an integer: 12, not 12.0 and not '12'. Copy it from the observation as it is.",
        stops=True,
        needs_answers=True,
    ),
    Rule(
        id="tick",
        sentence="answers with the tick of the observation that asked",
        remedy="Copy tick from the observation that awaits the command; do not count by yourself.",
        stops=True,
        needs_answers=True,
    ),
    Rule(
        id="finite",
        sentence="sends no NaN and no infinity",
        remedy="Look for a division by zero or a mean of nothing in the decision; send kind: hold when in doubt.",
        stops=True,
        needs_answers=True,
    ),
    Rule(
        id="byte-order",
        sentence="sends numbers in the byte order of their encoding",
        remedy="Msgpack numbers are big-endian (0xcb and the float64, highest byte first); a msgpack library does it. "
        "Arrays as raw bytes are little-endian, and a command has none: a position is a list of three numbers.",
        stops=True,
        needs_answers=True,
    ),
    Rule(
        id="schema",
        sentence="sends commands that fit the schema: the fields that the kind needs, each of its type and range",
        remedy="Compare with Command in docs/messages.md, and with the examples in agents/contract.",
        stops=True,
        needs_answers=True,
    ),
    Rule(
        id="once",
        sentence="answers each observation that awaits a command exactly once",
        remedy="Send the command in one place only.",
        needs_answers=True,
    ),
    Rule(
        id="unasked",
        sentence="sends nothing when it is not asked",
        remedy="Look at awaiting_command: where it is false the observation is for information.",
    ),
    Rule(
        id="beliefs",
        sentence="publishes at most one belief in a second of simulated time",
        remedy="Remember time_s of the observation that the last belief answered; send the next one a second later.",
    ),
    Rule(
        id="flood",
        sentence="sends no messages in masses",
        remedy="Send one command for each observation that awaits one; do not send in a loop of your own.",
        stops=True,
    ),
    Rule(
        id="own-key",
        sentence="writes only its own command and its own liveliness token",
        remedy="Write agents/<name>/command, with the name from GSLCOSIM_JOIN. In a run the router denies all else.",
        transports="zenoh",
    ),
    Rule(
        id="own-ears",
        sentence="reads only its own keys",
        remedy="Subscribe to agents/<name>/briefing, observation and ending, and query nothing. In a run the router "
        "denies all else, so that nobody sees the truth.",
        transports="zenoh",
    ),
    Rule(
        id="stays",
        sentence="stays until the end of the run",
        remedy="Read the end of its log: the agent crashed, exited, or closed its link while the run went on.",
        stops=True,
    ),
    *_ENDING_RULES,
    Rule(
        id="leaves-nothing",
        sentence="leaves no process behind when it has ended",
        remedy="End each program that it has started, and wait for it; a run ends with the agent what the agent "
        "started, be it by setsid, nohup or two forks.",
    ),
    Rule(
        id="restart",
        sentence="starts and flies a second time",
        remedy="Leave nothing behind that stands in the way of the next start: lock files, fixed ports, half files.",
        stage="later",
    ),
    Rule(
        id="determinism",
        sentence="sends the same commands again when seed and observations are the same",
        remedy="Draw all random numbers from a generator seeded with the briefing's seed; use neither clock nor "
        "process id, nor files of earlier runs, nor the order of a hash table that differs from run to run.",
        stage="later",
        change=", as before",
    ),
    _UNKNOWN_FIELDS,
    Rule(
        id="optional-fields",
        sentence="does without fields that have a default",
        remedy="Take the default of docs/messages.md where such a field is missing: notice is nil, is_saturated false.",
        stage="later",
        variation="optional fields",
        change=", without the fields that have a default",
    ),
    Rule(
        id="repeats",
        sentence="answers a repeated observation with the same bytes, without deciding anew",
        remedy="Keep the last answer, and send it again when an observation comes with the tick it answers; ignore a "
        "second briefing.",
        transports="zenoh",
        stage="later",
        variation="repeats",
        change=", some of them sent again after the answer",
    ),
    Rule(
        id="early-ending",
        sentence="exits with code 0 when the run ends before the first question",
        remedy="Wait for Ending wherever you wait for an observation: another agent may have ended the run.",
        stage="later",
        variation="ending at once",
        after=("ending", "exit-code"),
    ),
    Rule(
        id="stream-end",
        sentence="exits when the link to the run is lost",
        remedy="Leave when reading gives the end of the stream, or when Zenoh tells that the transport has closed. "
        "Otherwise it is left over when a run is killed.",
        stage="later",
        variation="lost link",
    ),
)

RULES = {rule.id: rule for rule in _AGENT_RULES}


_PARTICIPANT_RULES = (
    Rule(
        id="hello",
        sentence="starts, and says hello with the ports that it reads and writes",
        remedy="Run the command by itself and read its log. Send {tick: 0, reads: […], writes: […]} as the first "
        "frame, before anything comes, and flush it; over tcp and unix after {token: GSLCOSIM_TOKEN}.",
        stage="opening",
        stops=True,
    ),
    Rule(
        id="ports",
        sentence="names ports that there are, and a word for each of its outputs",
        remedy="Take ports from docs/messages.md, or participant/NAME/PORT. Outputs are ventilation or a word of your "
        "own of lower-case letters, digits and _.",
        stage="opening",
        stops=True,
    ),
    Rule(
        id="contract",
        sentence="says of its contract, if anything, what this gslcosim speaks",
        remedy="Build it with the contract that `gslcosim schema export` writes, or leave `contract` out.",
        stage="opening",
        stops=True,
    ),
    Rule(
        id="answers",
        sentence="answers the inputs of each tick, in time",
        remedy="Send one ParticipantOutputs for each ParticipantInputs, and flush it: a buffered line is not sent. "
        "Raise answer_within_s in the scenario (--timeout here) where a step takes longer.",
        stops=True,
    ),
    Rule(
        id="encoding",
        sentence="sends each frame as one map with texts as keys, of at most 1 MiB",
        remedy="Pack one map a frame, in the --format you have chosen. Over stdio nothing else may be written to the "
        "standard output: notes go to the standard error.",
        stops=True,
    ),
    Rule(
        id="tick",
        sentence="answers with the tick of the inputs, as an integer",
        remedy="Copy tick from ParticipantInputs; do not count by yourself: ticks leap where the period is longer.",
        stops=True,
    ),
    Rule(
        id="outputs",
        sentence="answers with each of its outputs, and no other",
        remedy="Write the map under every word of its hello, at each tick.",
        stops=True,
    ),
    Rule(
        id="values",
        sentence="sends finite numbers and truth values, and a `share` of at least 0",
        remedy="Look for a division by zero or a mean of nothing; ventilation needs share, other outputs have names.",
        stops=True,
    ),
    Rule(
        id="once",
        sentence="answers once, and says nothing that it is not asked",
        remedy="Send the answer in one place only, after the inputs have come.",
        stops=True,
    ),
    Rule(
        id="stays",
        sentence="stays until the end of the run",
        remedy="Read the end of its log: it crashed, exited, or closed its output while the run went on.",
        stops=True,
    ),
    *_ENDING_RULES,
    Rule(
        id="leaves-nothing",
        sentence="leaves no process behind when it has ended",
        remedy="End each program that it has started, and wait for it.",
        stage="any",
    ),
    Rule(
        id="restart",
        sentence="starts and steps a second time",
        remedy="Leave nothing behind that stands in the way of the next start: lock files, fixed ports, half files.",
        stage="later",
    ),
    Rule(
        id="determinism",
        sentence="gives the same outputs again when briefing and inputs are the same",
        remedy="Draw random numbers from a generator seeded with the briefing's seed; use neither clock nor process "
        "id, nor files of earlier runs, nor the order of a hash table that differs from run to run.",
        stage="later",
        change=", as before",
    ),
    _UNKNOWN_FIELDS,
    Rule(
        id="missing-inputs",
        sentence="does without an input where there is no message yet",
        remedy="A port is missing from inputs before tick 0 where it has a delay, and between the periods of its "
        "writer: keep the last value, or begin with one of your own.",
        stage="later",
        variation="missing inputs",
    ),
    Rule(
        id="early-ending",
        sentence="exits with code 0 when the run ends before the first inputs",
        remedy="Wait for Ending wherever you wait for inputs.",
        stage="later",
        variation="ending at once",
    ),
    Rule(
        id="stream-end",
        sentence="exits when the link to the run is lost",
        remedy="Leave when reading gives the end of the stream. Otherwise it is left over when a run is killed.",
        stage="later",
        variation="lost link",
    ),
)

PARTICIPANT_RULES = {rule.id: rule for rule in _PARTICIPANT_RULES}


Status = Literal["passed", "failed", "not_judged", "not_applicable"]

_MARKS: Mapping[Status, str] = {"passed": "PASS", "failed": "FAIL", "not_judged": " -- ", "not_applicable": " n/a"}
_WIDTH = 110
_INDENT = " " * 16


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
        failures: The breaks by rule.
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
