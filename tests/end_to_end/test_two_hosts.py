"""An agent on another host joins over TCP and over TLS; the hosts are network namespaces of this machine."""

import contextlib
import os
import shutil
import subprocess
import sys

import pytest
from flights import ROOT, TINY_ROOM, fly_here, start

HERE, THERE = "10.213.7.1", "10.213.7.2"
AGENT = ROOT / "agents" / "dung_beetle" / "agent.py"


def ip(*words, check=True):
    return subprocess.run(["ip", *words], capture_output=True, text=True, check=check)


@pytest.fixture
def hosts():
    """Two network namespaces with a cable between them and no way out."""
    if shutil.which("ip") is None or os.geteuid() != 0:
        pytest.skip("needs root and `ip` (Debian's iproute2) to make network namespaces")
    names = [f"gslcosim-{os.getpid()}-{side}" for side in "ab"]
    ends = [f"gs{os.getpid() % 100000}{side}" for side in "ab"]
    try:
        for name in names:
            ip("netns", "add", name)
        ip("link", "add", ends[0], "netns", names[0], "type", "veth", "peer", "name", ends[1], "netns", names[1])
        for name, end, address in zip(names, ends, (HERE, THERE), strict=True):
            ip("-n", name, "address", "add", f"{address}/24", "dev", end)
            ip("-n", name, "link", "set", end, "up")
            ip("-n", name, "link", "set", "lo", "up")
    except subprocess.CalledProcessError as error:
        for name in names:
            ip("netns", "delete", name, check=False)
        pytest.skip(f"network namespaces cannot be made here: {error.stderr.strip()}")
    yield names
    for name in names:
        ip("netns", "delete", name)


def certificate_of(address, folder):
    if shutil.which("openssl") is None:
        pytest.skip("needs openssl to make a certificate")
    call = ["openssl", "req", "-x509", "-newkey", "ec", "-pkeyopt", "ec_paramgen_curve:prime256v1", "-nodes"]
    call += ["-days", "2", "-keyout", "key.pem", "-out", "certificate.pem", "-subj", "/CN=supervisor"]
    call += ["-addext", f"subjectAltName=IP:{address}", "-addext", "basicConstraints=critical,CA:FALSE"]
    subprocess.run(call, cwd=folder, check=True, capture_output=True)
    return ["--tls-certificate", str(folder / "certificate.pem"), "--tls-key", str(folder / "key.pem")]


@pytest.mark.parametrize("protocol", ["tcp", "tls"])
def test_an_agent_on_another_host_flies_the_same_run(hosts, tmp_path, protocol):
    """The digest is that of a run on one host; nothing but the join file goes from one to the other."""
    here, there = hosts
    options = [f"--listen={protocol}/{HERE}:7447", f"--join-dir={tmp_path / 'join'}"]
    options += certificate_of(HERE, tmp_path) if protocol == "tls" else []
    join_file = tmp_path / "join" / "agents" / "beetle.json"
    agent = subprocess.Popen(
        ["ip", "netns", "exec", there, sys.executable, str(AGENT)],
        env={**os.environ, "GSLCOSIM_JOIN": str(join_file)},
    )
    with contextlib.ExitStack() as cleanup:
        cleanup.callback(agent.wait)
        cleanup.callback(agent.kill)
        flight = start(
            TINY_ROOM,
            tmp_path / "runs",
            *options,
            "--set",
            "agents[0].start={attach: true}",
            prefix=("ip", "netns", "exec", here),
        )
        ended = flight.end()
        assert ended.result.get("valid") is True, ended.errors
        assert agent.wait(timeout=15) == 0
    assert ended.result["digest"] == fly_here(TINY_ROOM, tmp_path / "alone").result["digest"]
