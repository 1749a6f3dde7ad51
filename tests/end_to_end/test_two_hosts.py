"""Services and agents of another host take part in a run; the hosts are network namespaces of this machine."""

import contextlib
import json
import os
import shutil
from pathlib import Path

import pytest
from deadlines import EVENT_S
from real_runs import ROOT, TINY_ROOM, fly_here, start
from two_hosts import HERE, Quality, make_certificates, two_hosts, why_not

from gslcosim.base.kernel_cache import get_cache_root

pytestmark = pytest.mark.debian

ATTACHED = ("--set", "agents[0].start={attach: true}")
MUTUAL_TLS = (
    "--tls-certificate=server.pem", "--tls-key=server.key", "--tls-ca=ca.pem", "--tls-client-ca=ca.pem",
)  # fmt: skip
# Longer than any test: it ends because of what the test does to it.
ENDLESS = ("--set", "referee.success.within_m=0.001", "--set", "referee.stop.time_limit_s=20000")
BAD = Quality(delay_s=0.1, loss_frac=0.05, reorder_frac=0.05)

EVENT_DOOR = ROOT / "scenarios" / "event_door.yaml"


@pytest.fixture(scope="module")
def digest_here(tmp_path_factory):
    """The digest of the run on one host."""
    return fly_here(TINY_ROOM, tmp_path_factory.mktemp("alone")).result["digest"]


@pytest.fixture
def hosts(request):
    """Two hosts with a cable between them, or with a wire of the quality that the test is given."""
    quality = getattr(request, "param", None)
    if reason := why_not(needs_wire=quality is not None):
        pytest.skip(reason)
    with two_hosts(quality) as both:
        yield both


@pytest.fixture
def there(hosts, tmp_path):
    """Start `gslcosim join` on the second host, which has nothing but the join file and its own empty disks."""
    started = []
    disk, runs = tmp_path / "there", tmp_path / "runs"
    disk.mkdir()
    runs.mkdir()

    def join(*words, **variables):
        hidden = (runs, get_cache_root() / "environments")
        elsewhere = {"GSLCOSIM_CACHE": str(disk / "cache"), "NUMBA_CACHE_DIR": os.environ["NUMBA_CACHE_DIR"]}
        process = hosts.start_there("join", *words, cwd=disk, hidden=hidden, **elsewhere, **variables)
        started.append(process)
        return process

    yield join
    for process in started:
        if process.poll() is None:
            process.kill()
        process.communicate()


def fly(hosts, tmp_path, *options):
    return start(TINY_ROOM, tmp_path / "runs", f"--join-dir={tmp_path / 'join'}", *options, prefix=hosts.run_here)


def certificates(folder):
    if shutil.which("openssl") is None:
        pytest.skip("needs openssl to make certificates")
    make_certificates(folder)


def with_paths(options, folder):
    return [option.replace("=", f"={folder}/") for option in options]


@pytest.mark.tour
def test_services_on_another_host_need_the_join_file_and_a_certificate_only(hosts, there, tmp_path, digest_here):
    """The room is fetched, the digest is that of one host; who has no certificate, or one of another, is not let in."""
    certificates(tmp_path)
    flight = fly(
        hosts, tmp_path, "--elsewhere=fields,sensing", f"--listen=tls/{HERE}:7447", *with_paths(MUTUAL_TLS, tmp_path)
    )
    file = tmp_path / "join" / "services" / "fields.json"
    flight.wait_for(file.exists)
    stranger = there(file, "fields")
    assert "--tls-certificate and --tls-key" in stranger.communicate(timeout=EVENT_S)[1]
    assert stranger.returncode == 2
    forger_dir = tmp_path / "forger"
    forger_dir.mkdir()
    make_certificates(forger_dir)
    forger = there(file, "fields", f"--tls-certificate={forger_dir}/client.pem", f"--tls-key={forger_dir}/client.key")
    assert "or the client certificate, were refused" in forger.communicate(timeout=EVENT_S)[1]
    assert forger.returncode == 3
    client = (f"--tls-certificate={tmp_path}/client.pem", f"--tls-key={tmp_path}/client.key")
    joined = there(file, "fields", "sensing", "--json", *client)
    ended = flight.end()
    output, errors = joined.communicate(timeout=EVENT_S)
    assert joined.returncode == 0, errors
    assert ended.result.get("valid") is True, ended.errors
    assert ended.result["digest"] == digest_here
    part = json.loads(output)
    assert (part["services"], part["is_whole"], part["recording"]) == (["fields", "sensing"], True, None)
    assert Path(part["run_dir"]).is_relative_to("runs")
    assert list((tmp_path / "there" / "cache" / "environments").glob("*/wind.npy"))


def test_what_events_make_of_the_room_is_fetched_too(hosts, there, tmp_path):
    """A door opens while the gas is elsewhere: that host needs the room with the door and without."""
    short = ("--set", "referee.stop.time_limit_s=15")
    alone = fly_here(EVENT_DOOR, tmp_path / "alone", *short).result["digest"]
    options = (f"--join-dir={tmp_path / 'join'}", "--elsewhere=fields", f"--listen=tcp/{HERE}:7447", "--insecure")
    flight = start(EVENT_DOOR, tmp_path / "runs", *options, *short, prefix=hosts.run_here)
    file = tmp_path / "join" / "services" / "fields.json"
    flight.wait_for(file.exists)
    joined = there(file, "fields")
    ended = flight.end()
    assert joined.wait(timeout=EVENT_S) == 0
    assert ended.result.get("digest") == alone, ended.errors
    assert len(list((tmp_path / "there" / "cache" / "environments").glob("*/wind.npy"))) == 2


@pytest.mark.parametrize("protocol", ["tcp", "tls"])
def test_an_agent_on_another_host_runs_the_same_run(hosts, there, tmp_path, digest_here, protocol):
    """Nothing but the join file goes from one to the other, which the agent's host waits for."""
    options = ["--insecure"]
    if protocol == "tls":
        certificates(tmp_path)
        options = with_paths(MUTUAL_TLS[:3], tmp_path)
    agent = there("--wait=60", tmp_path / "join" / "agents" / "beetle.json", "agent", "dung_beetle")
    ended = fly(hosts, tmp_path, f"--listen={protocol}/{HERE}:7447", *options, *ATTACHED).end()
    assert ended.result.get("valid") is True, ended.errors
    _, errors = agent.communicate(timeout=EVENT_S)
    assert agent.returncode == 0, errors
    assert ended.result["digest"] == digest_here


@pytest.mark.soak
@pytest.mark.parametrize("hosts", [BAD], indirect=True)
def test_a_bad_link_that_is_cut_for_three_seconds_changes_nothing_but_the_time(hosts, there, tmp_path, digest_here):
    """100 ms each way, 5 % of the packets lost and 5 % out of order, and nothing at all for 3 s in flight."""
    options = ("--elsewhere=fields,sensing", f"--listen=tcp/{HERE}:7447", "--insecure", "--window-ticks=1024")
    flight = fly(hosts, tmp_path, *options)
    file = tmp_path / "join" / "services" / "fields.json"
    joined = there("--wait=60", file, "fields", "sensing")
    flight.wait_until_flying()
    hosts.wire.cut(3.0)
    ended = flight.end()
    _, errors = joined.communicate(timeout=EVENT_S)
    assert ended.result.get("valid") is True, ended.errors
    assert ended.result["digest"] == digest_here
    assert joined.returncode == 0, errors


@pytest.mark.parametrize("hosts", [Quality(delay_s=0.02)], indirect=True)
def test_a_host_that_vanishes_is_named_within_its_lease(hosts, there, tmp_path):
    """The link is cut for good: the run ends with the service's name, and the other host notices too."""
    options = ("--elsewhere=fields", f"--listen=tcp/{HERE}:7447", "--insecure", "--lease-s=2")
    flight = fly(hosts, tmp_path, *options, *ENDLESS)
    there("--wait=60", tmp_path / "join" / "services" / "fields.json")
    flight.wait_until_flying()
    hosts.wire.cut()
    ended = flight.end()
    assert ended.exit_code == 3
    fault = ended.result["faults"][0]
    assert fault["participant"] == "fields"
    assert "contact was lost" in fault["text"]


@pytest.mark.parametrize("hosts", [Quality(delay_s=0.02)], indirect=True)
def test_an_agent_whose_host_vanishes_has_failed_within_its_lease(hosts, there, tmp_path):
    """The run is valid: an agent's fault is a result."""
    options = (f"--listen=tcp/{HERE}:7447", "--insecure", "--lease-s=2")
    flight = fly(hosts, tmp_path, *options, *ATTACHED, *ENDLESS)
    there("--wait=60", tmp_path / "join" / "agents" / "beetle.json", "agent", "dung_beetle")
    flight.wait_until_flying()
    hosts.wire.cut()
    ended = flight.end()
    assert (ended.exit_code, ended.result["valid"], ended.result["end_reason"]) == (1, True, "agent_failed")
    assert ended.result["faults"][0]["participant"] == "agent beetle"


def test_what_the_run_does_not_await_is_refused_and_ctrl_c_names_the_host(hosts, there, tmp_path):
    flight = fly(hosts, tmp_path, "--elsewhere=fields", f"--listen=tcp/{HERE}:7447", "--insecure")
    file = tmp_path / "join" / "services" / "fields.json"
    flight.wait_for(file.exists)
    wrong = there(file, "world")
    assert "awaits from elsewhere (fields), was 'world'" in wrong.communicate(timeout=EVENT_S)[1]
    assert wrong.returncode == 2
    right = there(file)
    lines = []
    while not lines or "ready" not in lines[-1]:
        lines.append(right.stderr.readline())
        assert lines[-1], lines
    with contextlib.suppress(ProcessLookupError):
        right.terminate()
    ended = flight.end()
    right.communicate(timeout=EVENT_S)
    assert right.returncode == 130
    assert ended.exit_code == 3
    assert ended.result["faults"][0]["participant"] == "fields"
    assert "was ended on" in ended.result["faults"][0]["text"]
