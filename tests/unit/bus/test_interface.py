"""The bus in memory behaves as the one over Zenoh where the framework relies on it."""

import pytest
from in_memory_bus import InMemoryHub, matches


@pytest.mark.parametrize(
    ("pattern", "key", "expected"),
    [
        ("truth/bodies", "truth/bodies", True),
        ("truth/bodies", "truth/samples", False),
        ("ctl/bye/*", "ctl/bye/world", True),
        ("ctl/bye/*", "ctl/bye", False),
        ("ctl/bye/*", "ctl/bye/world/again", False),
        ("agents/*/alive", "agents/beetle/alive", True),
        ("**", "truth/bodies", True),
        ("agents/**", "agents", True),
        ("**/alive", "agents/beetle/alive", True),
        ("**/alive", "agents/beetle/command", False),
    ],
)
def test_keys_match_as_zenohs_do(pattern, key, expected):
    """One star is one segment, two are any number of them."""
    assert matches(pattern, key) is expected


def test_watchers_learn_of_tokens_old_and_new():
    """A late watcher gets all that are there, and each that goes."""
    hub, seen = InMemoryHub(), []
    early = hub.open()
    early.declare_alive("alive/world")
    hub.open().watch_alive("alive/*", lambda key, is_alive: seen.append((key, is_alive)))
    hub.open().declare_alive("alive/fields")
    early.close()
    assert seen == [("alive/world", True), ("alive/fields", True), ("alive/world", False)]


def test_loss_is_seeded_and_spares_control():
    """The same seed loses the same messages; control messages arrive."""

    def received_keys(seed):
        hub, keys = InMemoryHub(loss_frac=0.5, seed=seed), []
        bus = hub.open()
        bus.subscribe("**", lambda key, payload: keys.append((key, payload)))
        for n in range(50):
            bus.publish("truth/bodies", bytes([n]))
            bus.publish("ctl/start", bytes([n]))
        return keys

    assert received_keys(1) == received_keys(1) != received_keys(2)
    assert sum(key == "ctl/start" for key, _ in received_keys(1)) == 50
    assert 0 < sum(key == "truth/bodies" for key, _ in received_keys(1)) < 50
