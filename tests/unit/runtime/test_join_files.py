"""Join files: what is wrong with one is reported with the file's name."""

import json

import pytest

from gslcosim.base.errors import UsageError
from gslcosim.bus.interface import Certificate
from gslcosim.runtime.network import JoinFile

SERVICE = {
    "name": "fields", "endpoint": "tls/host:7447", "namespace": "gsl/x", "user": "service", "password": "p",
    "run_dir": "/r",
}  # fmt: skip
AGENT = {**SERVICE, "name": "beetle", "user": "agent_beetle", "run_dir": None}


@pytest.fixture
def read(tmp_path):
    def read(content, **how):
        path = tmp_path / "file.json"
        path.write_text(content if isinstance(content, str) else json.dumps(content))
        return JoinFile.read(path, **how)

    return read


@pytest.fixture
def client(tmp_path):
    for name in ("client.pem", "client.key"):
        (tmp_path / name).write_text(name)
    return Certificate(certificate=tmp_path / "client.pem", private_key=tmp_path / "client.key")


def test_files_of_services_agents_and_gateway_agents_are_distinguished(read):
    assert read(SERVICE).is_for_agent is False
    assert read(AGENT).is_for_agent is True
    agent = read({"name": "ant", "gateway": "tcp:host:1", "token": "t", "format": "json"})
    assert (agent.is_for_agent, agent.join, agent.name) == (True, None, "ant")


def test_no_file_is_reported_at_once(tmp_path):
    with pytest.raises(UsageError, match=r"join file: expected a file, found none"):
        JoinFile.read(tmp_path / "none.json")


@pytest.mark.parametrize("content", ["", "{", "[1]", '"fields"', '{"name": "fields"}'])
def test_what_is_no_join_file_is_reported(read, content):
    with pytest.raises(UsageError, match=r"file\.json: expected JSON as `gslcosim up` writes it"):
        read(content)


def test_another_endpoint_replaces_that_of_the_file(read):
    assert read(SERVICE, endpoint="tls/10.0.0.7:1").join.endpoint == "tls/10.0.0.7:1"


def test_a_client_certificate_travels_as_text(read, client):
    join = read({**SERVICE, "needs_tls_client": True}, client=client).join
    assert (join.tls_client_certificate, join.tls_client_key) == ("client.pem", "client.key")


def test_a_client_certificate_that_is_needed_is_asked_for(read):
    with pytest.raises(UsageError, match="--tls-certificate and --tls-key"):
        read({**SERVICE, "needs_tls_client": True})


def test_a_client_certificate_without_tls_is_refused(read, client):
    with pytest.raises(UsageError, match="tls/"):
        read({**SERVICE, "endpoint": "tcp/host:7447"}, client=client)
