"""Validity of a run: findings for and against its figures, with the texts of all outputs.

The end of `up`, `result.json`, the recording, rows of a benchmark and its report take their findings from here.
docs/validity.md lists them with their keys; `tests/unit/validity/test_findings.py` compares the two.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal, NoReturn, cast

from gslcosim.base.extensions import FINDINGS_GROUP, load_registered
from gslcosim.environment.generation.provenance import WindProvenance, find_mixed_air, read_wind_provenance
from gslcosim.scenario import Scenario
from gslcosim.validity.conduct import GAS_CONTACT_PPM, AgentConduct, read_conduct

Severity = Literal["ok", "note", "quote", "warning"]
SEVERITIES: tuple[Severity, ...] = ("ok", "note", "quote", "warning")
Verdict = Literal["yes", "with warnings", "no"]

# Thresholds of warnings, all of them chosen: below them a figure moves the result of a run less than another seed does.
MAX_UNCERTAINTY_FRAC = 0.1
MAX_REFUSED_FRAC = 0.1
MAX_BLIND_FRAC = 0.2


@dataclass(frozen=True, kw_only=True)
class Finding:
    """One finding on a run.

    Attributes:
        about: Its subject, which is its key in `result.json`.
        severity: `ok`; `note`: to be known when the figure is compared; `quote`: to be quoted beside it in a paper;
            `warning`: to be explained there.
        text: A sentence.
        remedy: Its remedy, a sentence; empty if nothing is wrong.
        figures: The numbers behind it by stable keys.
    """

    about: str
    severity: Severity
    text: str
    remedy: str = ""
    figures: Mapping[str, Any] = field(default_factory=dict[str, Any])

    def as_fields(self) -> dict[str, Any]:
        """Return it as `result.json` has it."""
        return {"severity": self.severity, "text": self.text, "remedy": self.remedy, **self.figures}


@dataclass(frozen=True, kw_only=True)
class Validity:
    """All findings on a run.

    Attributes:
        findings: One for each subject with facts.
        is_complete: Whether the run came to a verdict, without a fault of the simulation.
    """

    findings: tuple[Finding, ...]
    is_complete: bool = True

    @property
    def verdict(self) -> Verdict:
        """`no` for a run that does not count at all, otherwise `yes` or `with warnings`."""
        if not self.is_complete:
            return "no"
        return "with warnings" if self.warnings else "yes"

    @property
    def warnings(self) -> tuple[Finding, ...]:
        """Those that a paper has to explain."""
        return tuple(finding for finding in self.findings if finding.severity == "warning")

    def as_fields(self) -> dict[str, Any]:
        """Return the block `validity` of `result.json`."""
        return {"verdict": self.verdict, **{finding.about: finding.as_fields() for finding in self.findings}}


def assess_run(
    scenario: Scenario,
    environments: Sequence[Path],
    *,
    summary: Mapping[str, Any],
    n_ticks: int,
    sandboxes: Mapping[str, str],
    unconfined: Sequence[str] = (),
    is_complete: bool = True,
    manifest: Mapping[str, Any] | None = None,
) -> Validity:
    """Return all findings on a run.

    Args:
        environments: The folder of its environment, and those that events made of it.
        summary: Summaries of its participants, by key.
        n_ticks: Its ticks.
        sandboxes: By agent and participant what its process was confined by.
        unconfined: Those of them without a sandbox.
        is_complete: Whether the run came to a verdict, without a fault of the simulation.
        manifest: The run's, where there is one.
    """
    found = [*_assess_air(scenario, environments), *assess_conduct(read_conduct(summary, n_ticks=n_ticks))]
    found += [_assess_isolation(sandboxes, unconfined), _assess_determinism(scenario)]
    found += _find_of_extensions(scenario, environments)
    if manifest is not None:
        found.append(_assess_software(manifest))
    return Validity(findings=tuple(found), is_complete=is_complete)


def assess_conduct(conduct: Sequence[AgentConduct]) -> Iterator[Finding]:
    """Yield the findings on commands, sensors and contact with gas.

    Args:
        conduct: Of the agents of a run; without agents there are no findings.
    """
    if not conduct:
        return
    yield _assess_commands(conduct)
    yield _assess_sensors(conduct)
    yield _assess_contact(conduct)


def _assess_air(scenario: Scenario, environments: Sequence[Path]) -> Iterator[Finding]:
    known = [read_wind_provenance(scenario, folder) for folder in environments]
    if not known:
        return
    # Of several environments the worst: what events make of the room counts as much as the room at the start.
    yield max((_assess_wind(scenario, wind) for wind in known), key=_rank)
    mixed = find_mixed_air(scenario, known[0].maker)
    figures = {"model": scenario.gas.model, "folder": scenario.gas.stored_folder}
    if mixed is not None:
        text = f"The gas was carried by another wind than the one beside it: {mixed.found}."
        yield Finding(about="gas", severity="warning", text=text, remedy=mixed.remedy, figures=figures)
    elif scenario.gas.stored_folder is not None:
        text = f"The gas of {scenario.gas.stored_folder} is played back beside the wind of {known[0].name}."
        remedy = "See that both are of one simulation: nothing in the files says so."
        yield Finding(about="gas", severity="note", text=text, remedy=remedy, figures=figures)
    else:
        yield Finding(about="gas", severity="ok", text=f"Gas by the model {scenario.gas.model}.", figures=figures)


def _rank(finding: Finding) -> tuple[int, float]:
    return SEVERITIES.index(finding.severity), finding.figures.get("uncertainty_frac") or 0.0


def _assess_wind(scenario: Scenario, wind: WindProvenance) -> Finding:
    severity, text, remedy = _judge_wind(scenario, wind)
    if scenario.has_driven_wind:
        text = f"{text} A service scales it during the run."
    figures = {
        "maker": wind.maker,
        "name": wind.name,
        "settled": wind.has_settled,
        "uncertainty_frac": None if wind.uncertainty_frac is None else round(wind.uncertainty_frac, 4),
    }
    return Finding(about="wind", severity=severity, text=text, remedy=remedy, figures=figures)


def _judge_wind(scenario: Scenario, wind: WindProvenance) -> tuple[Severity, str, str]:
    match wind.maker:
        case "built_in":
            return _judge_solved_wind(scenario, wind)
        case "openfoam":
            text = "Wind of OpenFOAM, solved up to end_time_s; nobody has checked whether it had settled."
            return "note", text, "Compare it with a later end_time_s, or take wind.solver: built_in without one."
        case "uniform":
            return "note", "The same wind everywhere: nothing in the room turns it.", "Take wind.solver: built_in."
        case "file" | "imported":
            text = f"Wind as read from {wind.name}; what is known of its quality is with its maker."
            return "note", text, "Say in a paper how it was simulated."
        case "package":
            return "note", f"Wind of the solver {wind.name} of another package.", "Say in a paper how it was validated."
        case _:
            text = f"Nothing in {wind.name} says who has solved its wind."
            return "note", text, "Make the environment with gslcosim generate, which writes it down."


def _judge_solved_wind(scenario: Scenario, wind: WindProvenance) -> tuple[Severity, str, str]:
    known = "" if wind.uncertainty_frac is None else f", its mean uncertain by at least {wind.uncertainty_frac:.0%}"
    if wind.has_settled is None:
        text = f"Wind of the built-in solver up to end_time_s{known}; nobody has checked whether it had settled."
        return "note", text, "Leave out wind.end_time_s: the solve then goes on until the statistics have settled."
    end = "" if wind.end_time_s is None else f" within {wind.end_time_s:.0f} s"
    remedy = _find_longer_solve(scenario)
    if not wind.has_settled:
        return "warning", f"The wind of the built-in solver has not settled{end}{known}.", remedy
    if (wind.uncertainty_frac or 0.0) > MAX_UNCERTAINTY_FRAC:
        return "note", f"The wind of the built-in solver has settled{end}{known}.", remedy
    return "ok", f"The wind of the built-in solver has settled{end}{known}.", ""


def _find_longer_solve(scenario: Scenario) -> str:
    max_time_s = getattr(scenario.wind, "max_time_s", None)
    if scenario.environment.path is not None or max_time_s is None:
        return "Solve it for longer (wind.max_time_s), or say the uncertainty beside the figures."
    return (
        f"Solve it for longer, for example --set wind.max_time_s={2 * max_time_s:g}, "
        "or say the uncertainty beside the figures."
    )


def _refuse(found: object) -> NoReturn:
    raise TypeError(f"expected a Finding, was {found!r:.60}")


def _find_of_extensions(scenario: Scenario, environments: Sequence[Path]) -> list[Finding]:
    try:
        finders = load_registered(FINDINGS_GROUP, lambda each: each if callable(each) else None, "a function")
        found: list[object] = [each for find in finders for each in cast("Any", find(scenario, environments))]
        return [each if isinstance(each, Finding) else _refuse(each) for each in found]
    # Another project's package may raise anything, and the run's result is worth more than its finding.
    except Exception as error:
        text = f"An extension that finds facts on a run's validity failed: {error!r}."
        return [Finding(about="extensions", severity="note", text=text, remedy="Correct or uninstall it.")]


def _assess_commands(conduct: Sequence[AgentConduct]) -> Finding:
    figures = {
        "agents": {
            each.agent: {
                "commands": each.n_commands,
                "refused": each.n_refused,
                "adjusted": each.n_adjusted,
                "first_refusal": each.first_refusal,
            }
            for each in conduct
        }
    }
    troubled = [each for each in conduct if each.n_refused or each.n_adjusted]
    if not troubled:
        none = "No agent gave a command." if not any(each.n_commands for each in conduct) else ""
        text = none or "All commands were carried out as they were given."
        return Finding(about="commands", severity="note" if none else "ok", text=text, figures=figures)
    worst = max(troubled, key=lambda each: (each.refused_frac, each.n_adjusted))
    # Of a swarm one stands for all: the figures have them all.
    text = " ".join(_describe_refusals(each) for each in (troubled if len(troubled) <= 2 else (worst,)))
    severity: Severity = "warning" if worst.refused_frac >= MAX_REFUSED_FRAC else "note"
    remedy = "Read notice in the observation, which says why, and answer it; the recording has each refusal in Events."
    return Finding(about="commands", severity=severity, text=text, remedy=remedy, figures=figures)


def _describe_refusals(each: AgentConduct) -> str:
    of = "" if each.n_refused else f" of {each.agent}"
    counts = [(each.n_refused, f"refused {each.n_refused} of {each.n_commands} commands of {each.agent}")]
    counts.append((each.n_adjusted, f"changed or cut short {each.n_adjusted}{of}"))
    done = " and ".join(text for n, text in counts if n)
    first = (each.first_refusal or "").rstrip(".")
    return f"The vehicle {done}{f', the first because {first}' if first else ''}."


def _assess_sensors(conduct: Sequence[AgentConduct]) -> Finding:
    figures = {
        "agents": {
            each.agent: {
                name: {
                    "saturated_frac": _frac(use.n_saturated, use.n_ticks),
                    "warming_up_frac": _frac(use.n_warming_up, use.n_ticks),
                }
                for name, use in each.sensors.items()
            }
            for each in conduct
        }
    }
    shares = [
        (_frac(n, use.n_ticks), f"{name} of {each.agent}", word)
        for each in conduct
        for name, use in each.sensors.items()
        for n, word in ((use.n_saturated, "saturated"), (use.n_warming_up, "warming up"))
    ]
    if not shares:
        return Finding(about="sensors", severity="note", text="No agent has a gas sensor.", figures=figures)
    share, who, word = max(shares, key=lambda each: each[0])
    if share == 0:
        text = "No gas sensor was saturated or warming up at any time."
        return Finding(about="sensors", severity="ok", text=text, figures=figures)
    remedies = {
        "saturated": "A saturated sensor shows no gradient: take one with a larger range, or a weaker source.",
        "warming up": "Readings mean nothing until then: start with a heated sensor (warm_up_s: 0), or run for longer.",
    }
    severity: Severity = "warning" if share >= MAX_BLIND_FRAC else "note"
    text = f"The sensor {who} was {word} for {share:.1%} of the time."
    return Finding(about="sensors", severity=severity, text=text, remedy=remedies[word], figures=figures)


def _frac(n: int, of: int) -> float:
    return round(n / of, 4) if of else 0.0


def _assess_contact(conduct: Sequence[AgentConduct]) -> Finding:
    figures = {
        "floor_ppm": GAS_CONTACT_PPM,
        "agents": {each.agent: {"first_contact_s": each.gas_contact_s} for each in conduct},
    }
    above = f" of more than {GAS_CONTACT_PPM:g} ppm"
    met = [each for each in conduct if each.gas_contact_s is not None]
    blind = [each.agent for each in conduct if each.has_succeeded and each.gas_contact_s is None]
    if blind and not met:
        text = f"{', '.join(blind)} found the source without ever meeting gas{above}: no olfaction was needed."
        remedy = "Start farther away, take a smaller success radius (within_m), or compare with a blind method."
        return Finding(about="contact", severity="warning", text=text, remedy=remedy, figures=figures)
    if not met:
        text = f"No agent ever met gas{above} at its sensors."
        remedy = (
            "See whether gas reaches where agents can be: gslcosim view shows the plume, gas.warm_up_s lets it grow."
        )
        return Finding(about="contact", severity="note", text=text, remedy=remedy, figures=figures)
    first_s = min(each.gas_contact_s for each in met if each.gas_contact_s is not None)
    count = f"{len(met)} of {len(conduct)} agents" if len(conduct) > 1 else met[0].agent
    text = f"{count} met gas{above}, first after {first_s:g} s."
    return Finding(about="contact", severity="ok", text=text, figures=figures)


def _assess_isolation(sandboxes: Mapping[str, str], free: Sequence[str]) -> Finding:
    figures = {"sandboxed": not free and bool(sandboxes), "sandboxes": dict(sandboxes)}
    if not sandboxes or free:
        text = f"Without a sandbox: {', '.join(free) or 'all agents'}; such an agent could read the truth."
        remedy = "Run it with --processes separate, on a machine on which gslcosim doctor finds a sandbox."
        return Finding(about="isolation", severity="note", text=text, remedy=remedy, figures=figures)
    text = "All agents ran in a sandbox, without a way to the truth."
    return Finding(about="isolation", severity="ok", text=text, figures=figures)


def _assess_determinism(scenario: Scenario) -> Finding:
    free = [agent.name for agent in scenario.agents if agent.is_free]
    figures = {"deterministic": not free}
    if free:
        text = f"{', '.join(free)} acts by the clock (mode: free): another run may come out differently."
        remedy = "Take mode: on_request for figures that others can repeat."
        return Finding(about="determinism", severity="note", text=text, remedy=remedy, figures=figures)
    text = "The same scenario, seed and versions give the same digest on every processor."
    return Finding(about="determinism", severity="ok", text=text, figures=figures)


def _assess_software(manifest: Mapping[str, Any]) -> Finding:
    lock, git = manifest.get("lock"), manifest.get("git")
    differing = lock["differing"] if lock else []
    figures: dict[str, Any] = {
        "version": manifest.get("gslcosim"),
        "git": git,
        "lock_sha256": lock["sha256"] if lock else None,
        "differing": differing,
        "installed_sha256": manifest.get("installed_sha256"),
    }
    what = f"gslcosim {manifest.get('gslcosim')}" + (f" ({git})" if git else "")
    if differing:
        some = ", ".join(differing[:3]) + (f" and {len(differing) - 3} more" if len(differing) > 3 else "")
        text = f"{what} with other packages than requirements.lock has: {some}."
        remedy = "Install what it names: pip install -r requirements.lock."
        return Finding(about="software", severity="note", text=text, remedy=remedy, figures=figures)
    if git and git.endswith("-dirty"):
        text, remedy = f"{what}, with changes of its own.", "Commit them: nobody else can get at this code."
        return Finding(about="software", severity="note", text=text, remedy=remedy, figures=figures)
    pinned = "as requirements.lock has them" if lock else f"hash {str(figures['installed_sha256'])[:12]}"
    return Finding(about="software", severity="ok", text=f"{what}, packages {pinned}.", figures=figures)


def format_validity(validity: Mapping[str, Any]) -> list[str]:
    """Return the lines of a validity block: warnings with remedies, what is to be quoted, and notes in one line.

    Args:
        validity: The block as `result.json` has it.
    """
    findings: dict[str, Mapping[str, Any]] = {about: found for about, found in validity.items() if about != "verdict"}
    lines = [f"valid      {validity['verdict']}"]
    for about, finding in findings.items():
        if (severity := finding["severity"]) in ("quote", "warning"):
            lines.append(f"  {severity:<7}  {about}: {' '.join(filter(None, (finding['text'], finding['remedy'])))}")
    if notes := [about for about, finding in findings.items() if finding["severity"] == "note"]:
        lines.append(f"  notes    {', '.join(notes)} (validity in result.json)")
    return lines
