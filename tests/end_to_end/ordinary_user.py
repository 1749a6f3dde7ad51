"""Tests that run as an ordinary user: those of continuous integration run as root in containers, users do not."""

import os
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

import pytest
from deadlines import PROCESS_S
from real_runs import ROOT

from gslcosim.base.kernel_cache import get_key_path

# Who may do nothing that others may not: nobody.
USER_ID = 65534


def run_as_ordinary_user(command, *, cwd=ROOT, variables=None, limit_s=2 * PROCESS_S):
    """Run a command as an ordinary user with a home and a cache of its own, or skip the test where that is impossible.

    It has a copy of root's compiled kernels, so that nothing is compiled again. `{home}` in a word is its home.
    """
    if os.getuid() != 0 or shutil.which("setpriv") is None or shutil.which("unshare") is None:
        pytest.skip("only root can become an ordinary user here")
    # Away from the folders of tests, which are closed to others.
    with tempfile.TemporaryDirectory(prefix="ordinary-", dir="/tmp") as name:
        home = Path(name)
        kernels = Path(os.environ["NUMBA_CACHE_DIR"])
        shutil.copytree(kernels, home / "cache" / "numba" / kernels.name)
        shutil.copy(get_key_path(), home / "cache" / "kernels.key")
        for path in (home, *home.rglob("*")):
            os.chown(path, USER_ID, USER_ID, follow_symlinks=False)
        home.chmod(0o755)
        around = {key: value for key, value in os.environ.items() if key not in ("NUMBA_CACHE_DIR", "GSLCOSIM_STATE")}
        around |= {"HOME": str(home), "TMPDIR": "/tmp", "GSLCOSIM_CACHE": str(home / "cache"), **(variables or {})}
        setpriv = ["setpriv", f"--reuid={USER_ID}", f"--regid={USER_ID}", "--clear-groups"]
        call = [*_making_python_visible(home), *setpriv, *(word.format(home=home) for word in command)]
        return subprocess.run(
            call, cwd=cwd, env=around, capture_output=True, text=True, timeout=limit_s, check=False
        )  # fmt: skip


def run_tests_as_ordinary_user(*words, limit_s=2 * PROCESS_S):
    """Run tests as an ordinary user."""
    call = [sys.executable, "-m", "pytest", "-q", "-n", "0", "-p", "no:cacheprovider", "--basetemp", "{home}/tests"]
    return run_as_ordinary_user([*call, *words], limit_s=limit_s)


# Return what precedes a command so that another user sees this Python in a home that is closed to others.
def _making_python_visible(folder):
    base = Path(sys.base_prefix)
    closed = next((each for each in reversed(base.parents) if not each.stat().st_mode & 0o001), None)
    if closed is None:
        return []
    kept = folder / "python"
    kept.mkdir()
    script = (
        f"mount --bind {base} {kept} && mount -t tmpfs -o mode=755 tmpfs {closed} && mkdir -p {base} && "
        f'mount --bind {kept} {base} && exec "$@"'
    )
    return ["unshare", "--mount", "--propagation", "private", "sh", "-c", script, "sh"]
