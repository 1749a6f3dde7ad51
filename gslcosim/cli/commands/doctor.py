"""`gslcosim doctor`: whether this machine can run simulations, one line per check, with remedies."""

import argparse

from gslcosim.base.errors import ExitCode
from gslcosim.cli.arguments import Command
from gslcosim.cli.terminal import add_json_option, write, write_json

EXAMPLES = """  gslcosim doctor
  gslcosim doctor --json"""


def _run(arguments: argparse.Namespace) -> int:
    from gslcosim.cli.doctor_checks import run_checks

    findings = []
    for finding in run_checks():
        findings.append(finding)
        if not arguments.json:
            remedy = f" {finding.remedy}" if finding.remedy else ""
            write(f"{finding.level:<4}  {finding.name:<17}  {finding.text}.{remedy}")
    is_able = all(finding.level != "FAIL" for finding in findings)
    if arguments.json:
        write_json({"able": is_able, "findings": [vars(finding) for finding in findings]})
    return 0 if is_able else ExitCode.FAULT


COMMAND = Command(
    name="doctor",
    summary="check Python, packages, Zenoh, drawing, memory, disk and cache, with remedies",
    examples=EXAMPLES,
    add_arguments=add_json_option,
    run=_run,
)
