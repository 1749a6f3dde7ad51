"""Commands of pages, typed as they stand in a folder of a reader."""

import os
import re
import shlex
import subprocess
import sys
from pathlib import Path

from deadlines import PROCESS_S
from real_runs import start_command

# The reader has installed gslcosim.
PATH = f"{Path(sys.executable).parent}:{os.environ['PATH']}"
# Runs that a page presupposes: two of one seed, the newest of them.
_GIVEN_RUNS = {"RUN_A": -2, "RUN_B": -1, "RUN": -1}
# What a shell expands, joins or diverts outside of quotes: such lines need one, and all that begin with other programs.
_NEEDS_A_SHELL = re.compile(r"[|&;<>()$`*?~{}\\!]")
_QUOTED = re.compile(r"""'[^']*'|"[^"$`\\]*\"""")


def type_line(line: str, folder: Path, *, limit_s: float = PROCESS_S) -> subprocess.CompletedProcess[str]:
    """Return the outcome of one line."""
    text = re.sub(r"\s+#.*", "", line).replace("$PWD", str(folder))
    if text.startswith("gslcosim ") and not _NEEDS_A_SHELL.search(_QUOTED.sub("", text)):
        words = shlex.split(text)
        command = start_command(words[1:], cwd=folder, variables={"PATH": PATH})
        output, errors = command.communicate(timeout=limit_s)
        return subprocess.CompletedProcess(words, command.returncode or 0, output, errors)
    environment = {**os.environ, "PATH": PATH}
    return subprocess.run(
        ["bash", "-e", "-c", line], cwd=folder, env=environment, capture_output=True, text=True, timeout=limit_s,
        check=False,
    )  # fmt: skip


def type_on_runs(line: str, folder: Path) -> subprocess.CompletedProcess[str]:
    """Return the outcome of one line that may name runs that are in the folder already."""
    runs = sorted((folder / "runs").glob("*"))
    for word, i in _GIVEN_RUNS.items():
        if re.search(rf"\b{word}\b", line):
            line = re.sub(rf"\b{word}\b", f"runs/{runs[i].name}", line)
    return type_line(line, folder)


def type_block(block: str, folder: Path, *, limit_s: float = PROCESS_S) -> subprocess.CompletedProcess[str]:
    """Return the outcome of lines, of which the first that fails is the last."""
    output = errors = ""
    for line in filter(None, block.replace("\\\n", "").splitlines()):
        if line.startswith("cd ") and not _NEEDS_A_SHELL.search(line):
            folder /= line.removeprefix("cd ")
            continue
        ended = type_line(line, folder, limit_s=limit_s)
        output, errors = output + ended.stdout, errors + ended.stderr
        if ended.returncode:
            return subprocess.CompletedProcess(line, ended.returncode, output, errors)
    return subprocess.CompletedProcess(block, 0, output, errors)
