"""A host gets scenario and room from the run's own host in pieces, and takes no other room for it."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from built_rooms import build_air
from in_memory_bus import InMemoryHub

from gslcosim.base.errors import RunTimeoutError, SimulationFault, UsageError
from gslcosim.environment.generation.cache import with_variants
from gslcosim.environment.model import EnvironmentVariant, content_hash
from gslcosim.environment.store import WIND_FILE, load_environment, save_environment
from gslcosim.runtime import remote_server
from gslcosim.runtime.distributed import protocol
from gslcosim.runtime.remote_join import check_offer
from gslcosim.runtime.remote_server import (
    RunServer,
    SoftwareVersions,
    fetch_environment,
    fetch_offer,
    find_local_environment,
)

SHAPE = (7, 6, 5)


def small_room(seed=4):
    """A room whose wind is different everywhere, so that no piece may be at another's place."""
    room = build_air(SHAPE, np.random.default_rng(seed).random((2, *SHAPE, 3), np.float32), cell_m=0.5)
    return replace(room, content_hash=content_hash(room, room.wind))


@pytest.fixture
def run(tmp_path, monkeypatch):
    """A run whose host offers it in small pieces, and a bus of another host with a cache of its own."""
    for module in (remote_server, remote_server):
        monkeypatch.setattr(module, "CHUNK_BYTES", 1000)
    monkeypatch.setattr(remote_server, "ANSWER_TIMEOUT_S", 0.2)
    monkeypatch.setattr(remote_server, "RETRY_AFTER_S", 0.05)
    # With the cache that knows the code already.
    SoftwareVersions.here()
    monkeypatch.setenv("GSLCOSIM_CACHE", str(tmp_path / "cache"))
    folder = tmp_path / "host" / "room"
    later = {EnvironmentVariant((), i): tmp_path / "host" / f"later_{i}" for i in (3, 1)}
    save_environment(small_room(), folder)
    for situation, its in later.items():
        save_environment(small_room(situation.i_wind), its)
    (tmp_path / "scenario.yaml").write_text("name: small\n")
    setup = SimpleNamespace(
        run_dir=SimpleNamespace(run_id="small-seed1", scenario=tmp_path / "scenario.yaml"),
        environment_dir=folder,
        environment=with_variants(load_environment(folder), later),
        later_rooms=later,
        paced_from_tick=None,
    )
    hub = InMemoryHub()
    RunServer(setup, ["fields", "sensing"]).serve_on(hub.open())
    return SimpleNamespace(hub=hub, bus=hub.open(), folder=folder, cache=tmp_path / "cache" / "environments")


def elsewhere(run):
    """The offer as a host without the run's disks understands it."""
    return fetch_offer(run.bus).model_copy(update={"environment_dir": "/on/the/other/host/room"})


def test_the_room_is_fetched_in_pieces_and_then_known_by_its_content(run):
    offer = elsewhere(run)
    assert (offer.run_id, offer.scenario, offer.expected) == ("small-seed1", "name: small\n", ["fields", "sensing"])
    assert max(offer.room_files.values()) > 3000, "several pieces"
    assert find_local_environment(offer) is None
    said = []
    folder = fetch_environment(run.bus, offer, said.append)
    fetched = load_environment(folder)
    assert fetched.content_hash == offer.environment_hash
    assert (folder / WIND_FILE).read_bytes() == (run.folder / WIND_FILE).read_bytes()
    assert find_local_environment(offer) == folder
    assert "fetching the room" in said[0]
    assert [path.name for path in run.cache.iterdir()] == [folder.name], "nothing half is left"


def test_what_events_make_of_the_room_is_fetched_too_in_its_order(run):
    offer = fetch_offer(run.bus)
    assert [each.room for each in offer.later_rooms] == [1, 2]
    for each, seed in zip(offer.later_rooms, (3, 1), strict=True):
        far = each.model_copy(update={"environment_dir": "/on/the/other/host/room"})
        fetched = load_environment(fetch_environment(run.bus, far, lambda _: None))
        np.testing.assert_array_equal(fetched.wind.velocity_m_s, small_room(seed).wind.velocity_m_s)


def test_a_room_that_lies_at_the_same_place_is_not_fetched(run):
    assert find_local_environment(fetch_offer(run.bus)) == run.folder


def test_a_room_that_was_changed_on_the_way_is_refused(run):
    offer = elsewhere(run)
    wind = bytearray((run.folder / WIND_FILE).read_bytes())
    wind[-2] ^= 1
    (run.folder / WIND_FILE).write_bytes(wind)
    with pytest.raises(SimulationFault, match="the fetched room: expected content"):
        fetch_environment(run.bus, offer, lambda _: None)
    assert list(run.cache.iterdir()) == []


def test_a_piece_that_never_comes_is_reported(run):
    offer = elsewhere(run)
    (run.folder / WIND_FILE).write_bytes(b"short")
    with pytest.raises(RunTimeoutError, match=rf"{WIND_FILE} of the room: expected a piece"):
        fetch_environment(run.bus, offer, lambda _: None)


def test_a_file_that_is_not_of_the_room_is_not_given_away(run):
    (run.folder / "secret").write_text("no")
    came = []
    for name in ("secret", "../../scenario.yaml", "/etc/passwd"):
        question = remote_server.ChunkRequest.model_construct(file=name, offset=0).to_bytes()
        run.bus.ask(remote_server.CHUNK_KEY, question, lambda _, payload: came.append(payload))
    run.bus.ask(remote_server.CHUNK_KEY, b"nonsense", lambda _, payload: came.append(payload))
    assert came == []


def test_a_run_that_offers_nothing_is_reported(run):
    with pytest.raises(RunTimeoutError, match="--elsewhere"):
        fetch_offer(InMemoryHub().open())


def test_who_has_come_is_known_and_who_is_not_awaited_is_refused(run):
    here = SoftwareVersions.here()
    check_offer(fetch_offer(run.bus), ["fields", "sensing"], here)
    run.bus.declare_alive(protocol.build_liveliness_key("fields"))
    offer = fetch_offer(run.bus)
    assert offer.present == ["fields"]
    check_offer(offer, ["sensing"], here)
    with pytest.raises(UsageError, match="fields has joined it already"):
        check_offer(offer, ["fields"], here)
    with pytest.raises(UsageError, match=r"from elsewhere \(fields, sensing\), was 'world'"):
        check_offer(offer, ["world"], here)


def test_a_host_with_another_software_is_refused(run):
    older = SoftwareVersions.here().model_copy(update={"version": "0.0.1"})
    with pytest.raises(UsageError, match=r"this host: expected gslcosim .*, was 0\.0\.1\. Install the same on both\."):
        check_offer(fetch_offer(run.bus), ["fields"], older)
