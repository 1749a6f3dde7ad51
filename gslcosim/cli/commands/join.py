"""`gslcosim join`: take part in a run on another host."""

import argparse
from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING

from gslcosim.base.errors import ExitCode, UsageError
from gslcosim.cli.arguments import Command, add_runs_dir_option, read_certificate
from gslcosim.cli.terminal import add_json_option, write, write_json, write_note

if TYPE_CHECKING:
    from gslcosim.runtime.network import JoinFile
    from gslcosim.runtime.remote_join import JoinResult

EXAMPLES = """  gslcosim join join/services/fields.json
  gslcosim join join/services/fields.json fields sensing --tls-certificate client.pem --tls-key client.key
  gslcosim join join/agents/beetle.json agent dung_beetle
  gslcosim join join/agents/beetle.json agent -- ./my_agent --fast"""
AGENT = "agent"


def _add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("file", type=Path, metavar="JOIN_FILE", help="join file of gslcosim up")
    parser.add_argument(
        "what",
        nargs="*",
        metavar="SERVICE",
        help=(
            "services to run in this process (default: that of the file); or the word agent and a "
            "bundled agent, a Python file or a command line"
        ),
    )
    parser.add_argument(
        "--wait", type=float, default=0.0, metavar="S", help="wait up to S seconds for the join file (default: 0)"
    )
    parser.add_argument(
        "--endpoint",
        metavar="ENDPOINT",
        help=("address of the run from here, if not that of the join file, for example tls/10.0.0.7:7447"),
    )
    parser.add_argument("--tls-certificate", type=Path, metavar="FILE", help="PEM certificate of this host")
    parser.add_argument("--tls-key", type=Path, metavar="FILE", help="PEM private key of the certificate")
    parser.add_argument("--trusted", action="store_true", help="allow programs of the run's scenario to start here")
    parser.add_argument("--quiet", action="store_true", help="print errors only")
    add_runs_dir_option(parser)
    add_json_option(parser)


def _run(arguments: argparse.Namespace) -> int:
    from gslcosim.runtime.network import JoinFile

    joined = JoinFile.read(
        arguments.file, wait_s=arguments.wait, endpoint=arguments.endpoint, client=read_certificate(arguments)
    )
    report: Callable[[str], None] = (lambda _: None) if arguments.quiet or arguments.json else write_note
    if arguments.what[:1] == [AGENT]:
        return _run_agent(joined, arguments.what[1:], arguments, report)
    if joined.join is None or joined.is_for_agent:
        raise UsageError(f"{joined.path}: expected a service's join file, or agent and its program after this agent's.")

    from gslcosim.runtime.remote_join import join_as_services

    names = arguments.what or [joined.name]
    part = join_as_services(joined.join, names, runs_dir=arguments.runs_dir, say=report, is_trusted=arguments.trusted)
    if arguments.json:
        recording = part.recording and str(part.recording)
        write_json({**asdict(part), "run_dir": str(part.run_dir), "recording": recording})
    elif not arguments.quiet:
        write(_format_result(part))
    if not part.is_whole:
        write_note(f"{part.run_id}: ended before its verdict; gslcosim up on the run's host says why.")
        return ExitCode.FAULT
    return ExitCode.SUCCESS


def _run_agent(
    joined: "JoinFile", words: list[str], arguments: argparse.Namespace, report: Callable[[str], None]
) -> int:
    from gslcosim.runtime.remote_join import build_agent_command, join_as_agent

    if not joined.is_for_agent:
        raise UsageError(f"{joined.path}: expected the join file of an agent, was that of service {joined.name}.")
    join_as_agent(joined, build_agent_command(words, is_behind_gateway=joined.join is None), say=report)
    if arguments.json:
        write_json({"agent": joined.name, "exit_code": 0})
    return ExitCode.SUCCESS


def _format_result(part: "JoinResult") -> str:
    end = "to its end" if part.is_whole else "not to its end"
    lines = [f"Took part as {', '.join(part.services)} up to tick {part.last_tick}, {end}."]
    if part.n_resends:
        lines.append(f"resends    {part.n_resends} messages had to be asked for again")
    lines.append(f"run        {part.run_dir}")
    if part.recording is not None:
        lines += [f"recording  {part.recording}", f"open it    gslcosim view {part.run_dir}"]
    return "\n".join(lines)


COMMAND = Command(
    name="join",
    summary="join a run on another host, as some of its services or as an agent",
    examples=EXAMPLES,
    add_arguments=_add_arguments,
    run=_run,
)
