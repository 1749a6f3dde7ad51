"""The page of the protocol between supervisor and hosts names every control message."""

import re
from pathlib import Path

from gslcosim.runtime.distributed import protocol

PAGE = Path(__file__).parents[2] / "docs" / "runtime-protocol.md"


def test_the_table_names_each_control_message_with_its_key():
    rows = [line.split("|")[1:3] for line in PAGE.read_text().splitlines() if line.startswith("|")]
    named = {name for message, _ in rows for name in re.findall(r"`(\w+)`", message)}
    own = {kind.__name__ for kind in protocol.ControlMessage.__subclasses__() if kind.__module__ == protocol.__name__}
    assert named == own
    keys = {key for _, column in rows for key in re.findall(r"`([^`]+)`", column)}
    builders = [protocol.build_progress_key, protocol.build_final_report_key, protocol.build_resend_key,
                protocol.build_finished_key, protocol.build_description_key, protocol.build_inspection_key]  # fmt: skip
    plain = {protocol.START_KEY, protocol.STOP_KEY, protocol.CLOSE_KEY, protocol.FAULT_KEY}
    assert keys == plain | {build("NAME") for build in builders} | {"bundle/NAME/.READERS."}
    assert protocol.build_bundle_key("NAME", ["READERS"]) in keys
