"""The page on recordings names every entity that there is, and no other."""

import re
from pathlib import Path

from scripted_flight import NOSE_AND_VANE, ON_BOARD

from gslcosim.contract import keys
from gslcosim.contract.messages import RadioMessage, RadioTraffic, RadioTransmission
from gslcosim.runtime.run_dir import MachineLog

PAGE = Path(__file__).parents[4] / "docs" / "recordings.md"
RACK = ("rack", (5.0, 4.0, 0.0), (6.0, 6.0, 3.0))
PLACES = {"<agent>": "agent_0", "<gas>": "ethanol", "<sensor>": r"\w+", "<quantity>": r"\w+", "<value>": r"\w+"}


def _documented():
    entities = re.findall(r"^\| `([^`]+)` \|", PAGE.read_text(), re.MULTILINE)
    for place, pattern in PLACES.items():
        entities = [entity.replace(place, pattern) for entity in entities]
    return [re.compile(f"/{entity}(/.*)?") for entity in entities]


def test_every_entity_is_explained_and_every_explained_one_is_recorded(record, make_room, rows_of, tmp_path):
    (tmp_path / "run").mkdir()
    log = MachineLog(tmp_path / "run")
    log.decided("agent_0", 3, 0.1)
    log.failed("agent agent_0", 3, "late")
    log.close()
    sent = RadioTransmission(sender="agent_0", message=RadioMessage(channel="radio", text="here"))
    path = record(
        n_ticks=35,
        room=make_room(obstacles=[RACK]),
        sensors=(*NOSE_AND_VANE, *ON_BOARD),
        channels=({"name": "radio"},),
        contacts=(("rack",),),
        plans=((), ((1.0, 0.0, 2.0),)),
        noters=("agent_0",),
        edit=lambda inbox: {**inbox, keys.RADIO: RadioTraffic(tick=inbox[keys.BODIES].tick, transmissions=(sent,))},
    )
    recorded = [entity for entity in rows_of(path) if not entity.startswith("/__")]
    documented = _documented()
    assert [entity for entity in recorded if not any(pattern.fullmatch(entity) for pattern in documented)] == []
    assert [pattern.pattern for pattern in documented if not any(map(pattern.fullmatch, recorded))] == []
