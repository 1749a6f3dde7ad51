"""What lets other hosts in: nothing unencrypted beyond this machine unless somebody says so."""

import json
import stat

import pytest

from gslcosim.base.errors import UsageError
from gslcosim.bus.interface import Certificate, JoinData
from gslcosim.runtime.network import Network, is_local_endpoint

SERVICES = ("world", "fields", "sensing", "referee")
JOIN = JoinData(
    name="fields", endpoint="unixsock-stream//x", namespace="gsl/x", user="service", password="p", run_dir="/r"
)


def refusal_of(network, **how):
    with pytest.raises(UsageError) as refused:
        network.check(SERVICES, **how)
    return str(refused.value)


@pytest.fixture
def certificate(tmp_path):
    for name in ("server.pem", "server.key", "ca.pem"):
        (tmp_path / name).write_text(name)
    return Certificate(certificate=tmp_path / "server.pem", private_key=tmp_path / "server.key")


@pytest.mark.parametrize(
    "endpoint", ["tcp/127.0.0.1:7447", "tcp/127.3.2.1:0", "tcp/[::1]:7447", "tcp/localhost:1", "unixsock-stream//tmp/x"]
)
def test_this_machine_needs_no_encryption(endpoint):
    assert is_local_endpoint(endpoint)
    Network(listen=(endpoint,)).check(SERVICES)


@pytest.mark.parametrize("endpoint", ["tcp/0.0.0.0:7447", "tcp/[::]:7447", "tcp/supervisor:7447", "tcp/10.1.2.3:1"])
def test_beyond_this_machine_tcp_has_to_be_wanted(endpoint):
    assert "--insecure" in refusal_of(Network(listen=(endpoint,)))
    Network(listen=(endpoint,), is_insecure=True).check(SERVICES)


def test_one_open_endpoint_among_closed_ones_is_found(certificate):
    listen = ("tls/0.0.0.0:7447", "tcp/0.0.0.0:7448")
    assert refusal_of(Network(listen=listen, tls=certificate)).startswith("--listen tcp/0.0.0.0:7448")


def test_an_agent_cannot_attach_from_elsewhere_over_the_gateways_tcp_unless_that_is_wanted(certificate):
    network = Network(listen=("tls/0.0.0.0:7447",), tls=certificate)
    with pytest.raises(UsageError, match="--insecure"):
        network.check_gateway("beetle")
    Network(listen=("tls/0.0.0.0:7447",), tls=certificate, is_insecure=True).check_gateway("beetle")
    Network(listen=("tcp/127.0.0.1:7447",)).check_gateway("beetle")


def test_services_that_the_run_does_not_have_are_refused():
    assert "'cameras'" in refusal_of(Network(elsewhere=("fields", "cameras")))
    Network(elsewhere=("all",)).check(SERVICES)


def test_one_process_has_no_services_elsewhere():
    assert "--processes" in refusal_of(Network(elsewhere=("fields",)), is_one_process=True)


@pytest.mark.parametrize("lease_s", [0.0, 0.5, 4000.0, float("nan")])
def test_a_lease_is_neither_too_short_nor_endless(lease_s):
    assert refusal_of(Network(lease_s=lease_s)).startswith("--lease-s")


@pytest.mark.parametrize("window_ticks", [0, 127, 1 << 17])
def test_a_window_is_neither_too_small_for_what_agents_show_nor_endless(window_ticks):
    assert refusal_of(Network(window_ticks=window_ticks)).startswith("--window-ticks")


def test_one_process_has_no_window():
    assert "--processes" in refusal_of(Network(window_ticks=1024), is_one_process=True)
    Network(window_ticks=1024).check(SERVICES)


def test_a_certificate_that_nobody_would_see_is_refused(certificate):
    assert "tls/" in refusal_of(Network(listen=("tcp/127.0.0.1:1",), tls=certificate))


def test_a_join_file_holds_what_is_needed_and_is_its_owners_alone(certificate, tmp_path):
    ca = tmp_path / "ca.pem"
    tls = Certificate(certificate=certificate.certificate, private_key=certificate.private_key, ca=ca, client_ca=ca)
    network = Network(listen=("tls/10.0.0.1:7447",), tls=tls, join_dir=tmp_path / "join", lease_s=20.0)
    path = network.write_join("services", JOIN, tmp_path)
    assert stat.S_IMODE(path.stat().st_mode) == 0o600
    fields = json.loads(path.read_text())
    assert (fields["endpoint"], fields["lease_s"], fields["tls_root_ca"]) == ("tls/10.0.0.1:7447", 20.0, "ca.pem")
    assert fields["needs_tls_client"] is True
