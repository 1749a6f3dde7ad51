"""The commands of docs/hosts.md, from keys to the end of the run, on two hosts that are network namespaces."""

import re
import shutil
import subprocess

import pytest
from deadlines import EVENT_S, PROCESS_S
from real_runs import COMMAND, ROOT, fly_here, wait_a_moment
from two_hosts import HERE, two_hosts, why_not

pytestmark = pytest.mark.debian

PAGE = ROOT / "docs" / "hosts.md"
# The page's host and the test's; copying between hosts is copying between folders here.
PRELUDE = f"""set -e
gslcosim() {{ {" ".join(COMMAND)} "$@"; }}
scp() {{ cp "${{@:1:$#-1}}" ../there; }}
"""


def blocks():
    text = PAGE.read_text().replace("192.0.2.7", HERE)
    return re.findall(r"```sh\n(.*?)```", text, re.DOTALL)


def shell(namespace, commands, cwd):
    call = ["ip", "netns", "exec", namespace, "bash", "-c", PRELUDE + commands]
    return subprocess.Popen(call, cwd=cwd, text=True, stdout=subprocess.PIPE, stderr=subprocess.PIPE)


@pytest.fixture
def folders(tmp_path):
    for name in ("here", "there"):
        (tmp_path / name).mkdir()
    return tmp_path / "here", tmp_path / "there"


def test_the_page_leads_from_two_machines_to_one_run(folders, tmp_path):
    if reason := why_not() or ("" if shutil.which("openssl") else "needs openssl"):
        pytest.skip(reason)
    here, there = folders
    keys, up, copy, join = blocks()
    with two_hosts() as hosts:
        made = shell(hosts.here, keys, here)
        _, errors = made.communicate(timeout=EVENT_S)
        assert made.returncode == 0, errors
        flight = shell(hosts.here, up, here)
        try:
            while not (here / "join" / "services" / "fields.json").exists():
                assert flight.poll() is None, flight.communicate()
                wait_a_moment()
            copied = shell(hosts.here, copy, here)
            copied.communicate(timeout=EVENT_S)
            assert copied.returncode == 0
            joined = shell(hosts.there, join, there)
            output, errors = joined.communicate(timeout=PROCESS_S)
            assert joined.returncode == 0, errors
            _, errors = flight.communicate(timeout=EVENT_S)
            assert flight.returncode in (0, 1), errors
        finally:
            flight.kill()
            flight.communicate()
    assert "Took part as fields, sensing up to tick" in output
    (run,) = (here / "runs").iterdir()
    alone = fly_here("tiny_room", tmp_path / "alone", is_recorded=True)
    assert f'"digest": "{alone.result["digest"]}"' in (run / "result.json").read_text()
