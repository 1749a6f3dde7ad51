"""A run's host that lies: whatever it offers and sends, `gslcosim join` says so or writes where it should."""

import contextlib
import json
import os
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import msgpack
import pytest
import yaml
from built_rooms import build_air
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st
from in_memory_bus import InMemoryHub

from gslcosim.base.errors import ContractError, GslCosimError, SimulationFault, UsageError
from gslcosim.bus.interface import JoinData
from gslcosim.environment.model import content_hash
from gslcosim.environment.store import save_environment
from gslcosim.runtime import remote_server
from gslcosim.runtime.distributed import protocol
from gslcosim.runtime.network import JoinFile
from gslcosim.runtime.remote_join import build_joined_setup
from gslcosim.runtime.remote_server import CHUNK_KEY, OFFER_KEY, RunOffer, RunServer, SoftwareVersions, fetch_offer
from gslcosim.scenario import dump_resolved, load_scenario
from gslcosim.scenario.serialization import dump_values

JOIN = {"name": "fields", "endpoint": "tcp/host:7447", "namespace": "gsl/x", "user": "service", "password": "p"}
GATEWAY = {"name": "ant", "gateway": "tcp:host:1", "token": "t", "format": "json"}
WAYS_OUT = (
    "..", ".", "", "../../victim", "../earlier", "/etc/passwd", "a/../../../victim", "a/b", "~", "~/.bashrc", "a\0b",
    "run\n", "\x1b[2J", "x" * 5000, ".hidden", "earlier", "%2e%2e", "wind.npy", "wind.npy/../../../victim", "-rf",
)  # fmt: skip
PATHS_OUT = ("/..", "/proc/self/../1/root", "relative", "//", "/tmp/", "/a/./b", "/dev", "/etc")
SCALARS = st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=40) | st.binary(max_size=40)
FOREIGN = st.recursive(SCALARS, lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(max_size=9), inner))
LIES = (
    st.sampled_from(WAYS_OUT) | st.sampled_from(PATHS_OUT) | st.sampled_from([-1, 1 << 40, 1 << 63, 10**30]) | FOREIGN
)
MANY = settings(max_examples=80, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])


@pytest.fixture(scope="module")
def host(tmp_path_factory):
    """What an honest host would offer, the places of the other host, and what may not change there."""
    base = tmp_path_factory.mktemp("lies")
    still = build_air((3, 4, 5), cell_m=0.5)
    room = replace(still, content_hash=content_hash(still, still.wind))
    save_environment(room, base / "host" / "room")
    (base / "scenario.yaml").write_text(dump_resolved(load_scenario("tiny_room").scenario))
    setup = SimpleNamespace(
        run_dir=SimpleNamespace(run_id="small-seed1", scenario=base / "scenario.yaml"),
        environment_dir=base / "host" / "room", environment=room, later_rooms={}, paced_from_tick=None,
    )  # fmt: skip
    hub = InMemoryHub()
    RunServer(setup, ["fields"]).serve_on(hub.open())
    offer = fetch_offer(hub.open()).model_dump() | {"environment_dir": "/on/the/other/host/room"}
    here = base / "home" / "deeper"
    for name in ("home/victim", "home/deeper/victim", "home/deeper/runs/earlier/result.json", "home/.bashrc"):
        (base / name).parent.mkdir(parents=True, exist_ok=True)
        (base / name).write_text("kept")
    (here / "runs" / "earlier" / "scenario.yaml").write_text(offer["scenario"])
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(remote_server, "ANSWER_TIMEOUT_S", 0.01)
        patch.setattr(remote_server, "RETRY_AFTER_S", 0.01)
        patch.setenv("GSLCOSIM_CACHE", str(here / "cache"))
        patch.chdir(here)
        yield SimpleNamespace(offer=offer, here=here, base=base, room=base / "host" / "room")


def kept(host):
    """Everything that no offer may change, by name and content."""
    cache, runs = host.here / "cache", host.here / "runs"
    return {
        path: path.read_bytes() if path.is_file() else b""
        for path in host.base.rglob("*")
        if not path.is_relative_to(cache) and (not path.is_relative_to(runs) or path.is_relative_to(runs / "earlier"))
    }


def join_with(host, offer, *, piece=None, run_dir=None):
    """Join as another host does, with what the lying one offers and sends; return the run's folder."""
    hub = InMemoryHub()
    lying = hub.open()
    lying.answer(OFFER_KEY, lambda _: [offer if isinstance(offer, bytes) else msgpack.packb(offer)])
    lying.answer(CHUNK_KEY, piece or (lambda question: [honest_piece(host, question)]))
    bus = hub.open()
    join = JoinData(**JOIN, run_dir=run_dir)
    named = ["fields"]
    return build_joined_setup(
        join, fetch_offer(bus), named, bus, runs_dir=host.here / "runs", say=lambda _: None, is_trusted=False
    ).run_dir.path


def honest_piece(host, question):
    fields = msgpack.unpackb(question)
    return (host.room / fields["file"]).read_bytes()[fields["offset"] :][: remote_server.CHUNK_BYTES]


def with_lie(offer, path, lie):
    """Return an offer with something else at a place in it."""
    first, *rest = path
    if not rest:
        return {**offer, first: lie}
    return {**offer, first: with_lie(offer[first], rest, lie)}


def test_an_honest_offer_is_taken(host):
    """Otherwise nothing here would prove anything."""
    before = kept(host)
    assert join_with(host, host.offer) == host.here / "runs" / "small-seed1"
    assert (host.here / "cache" / "environments" / host.offer["environment_hash"]).is_dir()
    assert kept(host) == before


PLACES = st.sampled_from(
    [("run_id",), ("environment_dir",), ("environment_hash",), ("room",), ("room_files",), ("scenario",),
     ("later_rooms",), ("expected",), ("present",), ("software",), ("paced_from_tick",), ("room_files", "wind.npy"),
     ("room_files", "environment.yaml"), ("room_files", "../../victim"), ("room_files", "/etc/victim"),
     ("software", "version"), ("software", "packages")]
)  # fmt: skip


@MANY
@given(place=PLACES, lie=LIES)
@example(place=("run_id",), lie="../victim")
@example(place=("run_id",), lie="earlier")
@example(place=("environment_hash",), lie="../../..")
@example(place=("room_files", "../../victim"), lie=3)
@example(place=("scenario",), lie="[" * 20000)
@example(place=("scenario",), lie="name: {a: &a [*a]}")
def test_no_offer_writes_elsewhere(host, place, lie):
    before = kept(host)
    try:
        lying = msgpack.packb(with_lie(host.offer, place, lie))
    except (OverflowError, ValueError):
        lying = msgpack.packb(with_lie(host.offer, place, str(lie)))
    with contextlib.suppress(GslCosimError):
        assert join_with(host, lying).parent == host.here / "runs"
    assert kept(host) == before
    assert not list((host.here / "cache" / "environments").glob(".*"))


@MANY
@given(st.binary(max_size=200) | FOREIGN.map(lambda value: msgpack.packb(value, default=str)))
def test_no_bytes_are_an_offer(host, payload):
    with pytest.raises(SimulationFault, match="the run's offer"):
        join_with(host, payload)


@settings(MANY, max_examples=40)
@given(pieces=st.lists(st.binary(max_size=3000), max_size=3), n_more=st.sampled_from([0, 1, 1 << 18]))
def test_no_pieces_are_taken_for_a_room(host, pieces, n_more):
    before = kept(host)
    far = {**host.offer, "environment_hash": "0" * 32}
    with pytest.raises(GslCosimError):
        join_with(host, far, piece=lambda _: [piece + bytes(n_more) for piece in pieces])
    assert kept(host) == before


@pytest.mark.parametrize(
    ("lie", "expected"),
    [
        ({"run_id": "../victim"}, "RunOffer: run_id: expected something else"),
        ({"environment_hash": "../../.."}, "RunOffer: environment_hash"),
        ({"room_files": {"../../victim": 3}}, "RunOffer: room_files"),
        ({"environment_dir": "/a/../b"}, "RunOffer: environment_dir"),
        ({"later_rooms": [{}]}, "RunOffer: later_rooms.0.environment_dir"),
        ({"scenario": "name: x"}, "expected a scenario as resolved"),
    ],
)
def test_what_is_wrong_is_named(host, lie, expected):
    with pytest.raises(SimulationFault, match=expected):
        join_with(host, {**host.offer, **lie})


@pytest.mark.parametrize("is_shared", [False, True])
def test_a_run_of_that_name_is_neither_written_over_nor_taken_for_the_shared_one(host, is_shared):
    run_dir = str(host.here / "runs" / "earlier") if is_shared else None
    with pytest.raises(UsageError, match="The folder of --runs-dir already has another earlier"):
        join_with(host, {**host.offer, "run_id": "earlier"}, run_dir=run_dir)


def test_a_room_that_does_not_fit_on_the_disk_is_refused_before_it_is_fetched(host):
    large = {**host.offer["room_files"], "wind.npy": 1 << 37}
    with pytest.raises(GslCosimError, match="MB on the disk of the cache"):
        join_with(host, {**host.offer, "environment_hash": "1" * 32, "room_files": large})


def test_a_pipe_in_the_folder_that_the_host_names_is_not_opened(host, tmp_path):
    os.mkfifo(tmp_path / "environment.yaml")
    assert join_with(host, {**host.offer, "environment_dir": str(tmp_path)}).name == "small-seed1"


def test_a_program_of_the_scenario_is_started_only_where_that_is_trusted(host):
    """A model of the run's own may have the name of a service of ours."""
    own = {"name": "fields", "start": {"command": ["touch", "/tmp/started"]}, "reads": [], "writes": ["x"]}
    text = dump_values(yaml.safe_load(host.offer["scenario"]) | {"participants": [own]})
    with pytest.raises(UsageError, match=r"participants\.fields: expected --trusted, .*: touch /tmp/started"):
        join_with(host, {**host.offer, "scenario": text})


JOIN_KEYS = [*JOIN, "run_dir", "tls_root_ca", "agents", "lease_s", "mesh", "window_ticks"]
JOIN_FIELDS = st.sampled_from([(JOIN, key) for key in JOIN_KEYS] + [(GATEWAY, key) for key in (*GATEWAY, "agents")])


@MANY
@given(of=JOIN_FIELDS, lie=LIES)
@example(of=(JOIN, "password"), lie="p\nservice:mine")
@example(of=(JOIN, "endpoint"), lie="tls/host:1#root_ca_private_key_file=/etc/passwd")
@example(of=(JOIN, "endpoint"), lie="serial//dev/ttyS0")
@example(of=(JOIN, "namespace"), lie="**")
@example(of=(GATEWAY, "token"), lie="t\nLD_PRELOAD=x")
@example(of=(GATEWAY, "gateway"), lie="unix:relative")
def test_no_join_file_gives_other_than_plain_names(tmp_path, of, lie):
    content, field = of
    path = tmp_path / "join.json"
    path.write_text(json.dumps({**content, field: lie}, default=str))
    try:
        joined = JoinFile.read(path)
    except UsageError:
        return
    data = (joined.join or joined.gateway).model_dump(exclude={"tls_root_ca", "tls_client_key", "run_dir"})
    plain = json.dumps(data, ensure_ascii=True)
    assert not any(code in plain for code in ("\\n", "\\u00", "#", "*", "$")), plain
    assert joined.join is None or (joined.join.mesh is None and not joined.join.is_watched)


@pytest.mark.parametrize("content", ["[" * 100_000, '{"name": ' * 5000, "x" * (1 << 21), json.dumps({"gateway": None})])
def test_a_join_file_that_is_none_is_reported(tmp_path, content):
    (tmp_path / "join.json").write_text(content)
    with pytest.raises(UsageError, match=r"join\.json"):
        JoinFile.read(tmp_path / "join.json")


@MANY
@given(
    kind=st.sampled_from([protocol.TickReport, protocol.ReaderReport, protocol.FaultReport,
                          protocol.ResendRequest, protocol.ParticipantDescription, protocol.ParticipantInspection,
                          protocol.FinalReport, RunOffer]),
    payload=st.binary(max_size=100) | FOREIGN.map(lambda value: msgpack.packb(value, default=str)),
)  # fmt: skip
def test_no_bytes_are_a_control_message_but_their_own(kind, payload):
    with pytest.raises(ContractError, match=kind.__name__):
        kind.from_bytes(payload)


@MANY
@given(name=st.sampled_from(WAYS_OUT))
def test_no_message_names_a_file_elsewhere(name):
    """The log of a participant that is at fault is read and shown, by its name."""
    payload = msgpack.packb({"participant": name, "tick": 3, "text": ""})
    try:
        expected = protocol.FaultReport.from_bytes(payload).participant
    except ContractError:
        return
    assert Path("logs", f"{expected}.log").parent == Path("logs")
    assert ".." not in Path(expected).parts


def test_software_that_is_the_same_is_the_same_after_a_journey():
    here = SoftwareVersions.here()
    assert SoftwareVersions.model_validate(here.model_dump()) == here
