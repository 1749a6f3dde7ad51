"""Keys, tokens, quality of service and attachments are the bytes that nodes of rmw_zenoh send."""

import pytest

from gslcosim_ros import wire
from gslcosim_ros.wire import Attachment, QosProfile, Token

FLOAT32 = "RIHS01_7170d3d8f841f7be3172ce5f4f59f3a4d7f63b0447e8b33327601ad64d83d6e2"
PUBLISHER = Token(
    domain=0, session="a1", node_id=3, entity_id=4, kind=wire.PUBLISHER, namespace="/", node="zenoh_publisher",
    name="/gas", type="std_msgs/msg/Float32", type_hash=FLOAT32, qos=QosProfile().text,
)  # fmt: skip


def test_a_key_has_domain_name_type_and_hash():
    assert (
        wire.build_key(0, "/gas", "std_msgs/msg/Float32", FLOAT32) == f"0/gas/std_msgs::msg::dds_::Float32_/{FLOAT32}"
    )
    assert wire.build_key(7, "/a/b", "std_srvs/srv/Trigger", wire.NO_HASH) == (
        "7/a/b/std_srvs::srv::dds_::Trigger_/TypeHashNotSupported"
    )


@pytest.mark.parametrize("name", ["gas", "/", "/a//b", "/a/", "/a b", "/**", "/1a", ""])
def test_what_is_no_name_gets_no_key(name):
    with pytest.raises(ValueError, match="expected a name such as"):
        wire.build_key(0, name, "std_msgs/msg/Float32", FLOAT32)


def test_a_token_is_that_of_the_peers():
    assert PUBLISHER.key == (
        f"@ros2_lv/0/a1/3/4/MP/%/%/zenoh_publisher/%gas/std_msgs::msg::dds_::Float32_/{FLOAT32}/::,10:,:,:,,"
    )
    node = Token(domain=0, session="a1", node_id=3, entity_id=3, kind=wire.NODE, namespace="/beetle", node="agent")
    assert node.key == "@ros2_lv/0/a1/3/3/NN/%/%beetle/agent"
    assert [Token.parse(each.key) for each in (PUBLISHER, node)] == [PUBLISHER, node]


@pytest.mark.parametrize(
    "key", ["", "@ros2_lv/0/a/1", "@ros2_lv/x/a/1/1/NN/%/%/n", "0/gas/T/H", "@ros2_lv/0/a/1/1/QQ/%/%/n"]
)
def test_a_key_of_anybody_is_no_token(key):
    assert Token.parse(key) is None


def test_an_attachment_has_33_bytes():
    attachment = Attachment(sequence=1, stamp_ns=2, gid=bytes(range(16)))
    data = attachment.to_bytes()
    assert data == b"\x01" + bytes(7) + b"\x02" + bytes(7) + b"\x10" + bytes(range(16))
    assert Attachment.from_bytes(data) == attachment
    for wrong in (b"", data[:-1], data[:16] + b"\x0f" + data[17:]):
        with pytest.raises(ValueError, match="expected an attachment"):
            Attachment.from_bytes(wrong)


def test_endpoints_that_never_meet_are_found():
    def other(**changes):
        fields = {"kind": wire.SUBSCRIBER, "node": "rviz", **changes}
        return Token(**{**PUBLISHER.__dict__, **fields})

    same, old = other(), other(type_hash="RIHS01_0")
    elsewhere, also_writes = other(name="/wind", type="x/msg/Y"), other(kind=wire.PUBLISHER, type="x/msg/Y")
    assert wire.find_mismatches([PUBLISHER], [same, old, elsewhere, also_writes]) == [(PUBLISHER, old)]
