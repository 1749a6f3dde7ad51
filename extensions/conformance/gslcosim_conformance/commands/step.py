"""`gslcosim step`: step, reset and inspect a simulation, by options or by lines from standard input."""

import argparse
import json
import sys
from typing import TYPE_CHECKING, Any

from gslcosim.base.errors import UsageError
from gslcosim.cli.arguments import (
    Command,
    add_scenario_arguments,
    build_number_parser,
)
from gslcosim.cli.terminal import add_json_option, finish_output, write, write_note, write_prompt

if TYPE_CHECKING:
    from gslcosim.contract.record import Record
    from gslcosim.simulation.simulation import Simulation

EXAMPLES = """  gslcosim step tiny_room --ticks 100
  gslcosim step tiny_room --seed 3 --ticks 100 --every 20 --truth --json
  gslcosim step tiny_room --json          then lines on standard input: step 50, truth, reset 4, quit
  gslcosim step tiny_room --set 'agents[0].start={attach: true}'"""

LINES = """lines: step [TICKS]            simulate ticks (default: 1; an empty line is one)
       command AGENT JSON       answer for an agent that is asked, for example {"kind": "noop"}
       observe                  print the observations of all agents
       truth                    print true poses, sensors' true gas and wind, distances to the source
       sample X Y Z             print true gas and wind at a point
       reset [SEED]             start again before tick 0
       quit                     end"""

# Period of the check for Ctrl-C.
_WAKE_UP_S = 0.5
_parse_ticks = build_number_parser("a whole number of at least 1", lambda number: number >= 1 and number % 1 == 0)


def _add_arguments(parser: argparse.ArgumentParser) -> None:
    add_scenario_arguments(parser)
    parser.add_argument(
        "--ticks",
        type=_parse_ticks,
        metavar="N",
        help="simulate so many ticks, print the state and end (default: read lines; help is one of them)",
    )
    parser.add_argument("--every", type=_parse_ticks, metavar="N", help="with --ticks, print the state every N ticks")
    parser.add_argument("--truth", action="store_true", help="print the true state too")
    add_json_option(parser)


def _run(arguments: argparse.Namespace) -> int:
    from gslcosim.simulation.simulation import Simulation

    if arguments.every is not None and arguments.ticks is None:
        raise UsageError("--every: expected --ticks with it, found none.")
    with Simulation(arguments.scenario, seed=arguments.seed, overrides=arguments.set) as simulation:
        shell = _Shell(simulation, is_json=arguments.json, has_truth=arguments.truth)
        if arguments.ticks is None:
            shell.read_lines()
        else:
            shell.step_all(int(arguments.ticks), int(arguments.every or arguments.ticks))
    return 0


class _Shell:
    """Executes lines and prints the state after each: as text, or as one JSON object per line."""

    def __init__(self, simulation: "Simulation", *, is_json: bool, has_truth: bool) -> None:
        self._simulation = simulation
        self._is_json = is_json
        self._has_truth = has_truth

    def step_all(self, n_ticks: int, every: int) -> None:
        simulation = self._simulation
        last = simulation.tick + n_ticks
        while simulation.tick < last and not simulation.is_over:
            simulation.step(min(every, last - simulation.tick))
            self._show_state()
            if simulation.asked:
                raise UsageError(
                    f"--ticks: expected agents that decide by themselves, was {', '.join(simulation.asked)}, which "
                    f"awaits a command at tick {simulation.tick}. Leave out --ticks and give lines."
                )

    def read_lines(self) -> None:
        is_person = sys.stdin.isatty() and not self._is_json
        if is_person:
            write(LINES)
        while True:
            if is_person:
                write_prompt(f"{self._simulation.time_s:g} s> ")
            line = sys.stdin.readline()
            if not line or line.strip() == "quit":
                return
            try:
                self._carry_out(line)
            except UsageError as error:
                # A wrong line does not end the session.
                self._show({"error": str(error)}, str(error))
            finish_output()

    def _carry_out(self, line: str) -> None:
        word, *rest = line.split(maxsplit=1) or ["step"]
        text = rest[0].strip() if rest else ""
        simulation = self._simulation
        match word:
            case "step":
                simulation.step(_parse_whole(text, "step") if text else 1)
                self._show_state()
            case "reset":
                simulation.reset(_parse_whole(text, "reset") if text else None)
                self._show_state()
            case "command":
                self._command(text)
                self._show_state()
            case "observe":
                observations = {name: _as_fields(seen) for name, seen in simulation.observe().items()}
                self._show({"observations": observations}, json.dumps(observations, indent=2))
            case "truth":
                truth = self._truth()
                self._show({"truth": truth}, json.dumps(truth, indent=2))
            case "sample":
                self._sample(text)
            case "help":
                self._show({"help": LINES}, LINES)
            case _:
                raise UsageError(f"expected step, command, observe, truth, sample, reset, help or quit, was {word!r}.")

    def _command(self, text: str) -> None:
        from gslcosim.base.errors import ContractError
        from gslcosim.contract import codec
        from gslcosim.contract.messages import Command as AgentCommand

        agent, _, words = text.partition(" ")
        question = self._simulation.get_question(agent)
        try:
            fields: Any = json.loads(words)
            if question is None or not isinstance(fields, dict):
                raise ValueError("an object in JSON, for an agent that is asked")
            command = codec.build_message(AgentCommand, {"tick": question.tick, **fields})
        except (ValueError, ContractError) as error:
            asked = ", ".join(self._simulation.asked) or "none"
            raise UsageError(
                f"command: expected AGENT JSON for one of the agents that are asked ({asked}), was {text!r} ({error})."
            ) from error
        self._simulation.command(agent, command)

    def _sample(self, text: str) -> None:
        try:
            point_m = [float(word) for word in text.split()]
        except ValueError:
            point_m = []
        if len(point_m) != 3:
            raise UsageError(f"sample: expected three numbers X Y Z in metres, was {text!r}.")
        truth = self._simulation.truth
        ppm = {gas: float(truth.gas_ppm(point_m, gas)[0]) for gas in truth.gases}
        wind_m_s = truth.wind_m_s(point_m)[0].tolist()
        gases = ", ".join(f"{gas} {value:.6g} ppm" for gas, value in ppm.items())
        self._show(
            {"position_world_m": point_m, "mixing_ratio_ppm": ppm, "wind_world_m_s": wind_m_s},
            f"{gases}, wind {_format_vector(wind_m_s)} m/s",
        )

    def _show_state(self) -> None:
        simulation = self._simulation
        verdict = simulation.outcome.verdict
        state: dict[str, Any] = {
            "tick": simulation.tick,
            "time_s": simulation.time_s,
            "is_over": simulation.is_over,
            "end_reason": verdict and verdict.end_reason,
            "asked": list(simulation.asked),
            "digest": simulation.digest if simulation.n_finished_ticks else None,
            "observations": {name: _as_fields(seen) for name, seen in simulation.observe().items()},
        }
        if self._has_truth:
            state["truth"] = self._truth()
        self._show(state, self._format_state())

    def _truth(self) -> dict[str, Any]:
        simulation = self._simulation
        return {
            "bodies": {name: _as_fields(body) for name, body in simulation.truth.bodies.items()},
            "samples": [_as_fields(sample) for sample in simulation.truth.samples],
            "distance_to_source_m": {name: score.distance_to_source_m for name, score in simulation.scores.items()},
        }

    def _format_state(self) -> str:
        simulation = self._simulation
        verdict = simulation.outcome.verdict
        lines = [f"tick {simulation.tick}, {simulation.time_s:g} s" + (f", {verdict.end_reason}" if verdict else "")]
        for name, seen in simulation.observe().items():
            asked = ", awaits a command" if name in simulation.asked else ""
            lines.append(f"  {name}: {seen.status} at {_format_vector(seen.position_world_m)} m{asked}")
            if self._has_truth:
                body, score = simulation.truth.bodies[name], simulation.scores.get(name)
                distance = "" if score is None else f", {score.distance_to_source_m:.3f} m from the source"
                lines.append(f"    truth: at {_format_vector(body.position_world_m)} m{distance}")
        return "\n".join(lines)

    def _show(self, fields: dict[str, Any], text: str) -> None:
        if self._is_json:
            write(json.dumps(fields))
        elif "error" in fields:
            write_note(text)
        else:
            write(text)


def _parse_whole(text: str, word: str) -> int:
    try:
        return int(text)
    except ValueError as error:
        raise UsageError(f"{word}: expected a whole number, was {text!r}.") from error


# Rows of an IMU's physics steps are input of its model, and too long to read.
def _as_fields(record: "Record") -> dict[str, Any]:
    from gslcosim.contract import codec

    fields = {key: value for key, value in record.model_dump(exclude_none=True).items() if key != "inertial_body"}
    return json.loads(codec.dump_json_line(fields))


def _format_vector(vector: Any) -> str:
    return "({:.3f}, {:.3f}, {:.3f})".format(*vector)


COMMAND = Command(
    name="step",
    is_computing=True,
    summary="step a scenario tick by tick, by lines from standard input or by a number of ticks, and print its state",
    examples=EXAMPLES,
    add_arguments=_add_arguments,
    run=_run,
)
