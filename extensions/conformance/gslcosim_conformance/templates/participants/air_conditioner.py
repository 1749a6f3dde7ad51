"""A participant behind the gateway, with JSON lines over standard input and output; needs nothing but Python.

An air conditioner that turns the inlet up while any sensor is in gas, and slowly down again afterwards.
"""

import json
import sys


def say(message: dict) -> None:
    """Send one line."""
    sys.stdout.write(json.dumps(message) + "\n")
    sys.stdout.flush()


say({"tick": 0, "reads": ["truth/samples"], "writes": ["ventilation", "state"]})
above_ppm, full_share, most_change = 1.0, 3.0, 0.1
share, n_ticks = 1.0, 0
for line in sys.stdin:
    message = json.loads(line)
    if message["message"] == "Ending":
        break
    if message["message"] == "ParticipantBriefing":
        parameters = message["parameters"]
        above_ppm = parameters.get("above_ppm", 1.0)
        full_share = parameters.get("full_share", 3.0)
        period_s = message["period_ticks"] * message["tick_ns"] / 1e9
        most_change = abs(full_share - 1.0) * period_s / parameters.get("ramp_s", 2.0)
        continue
    samples = message["inputs"].get("truth/samples", {"samples": []})["samples"]
    is_in_gas = any(gas["mixing_ratio_ppm"] > above_ppm for sample in samples for gas in sample["gases"])
    n_ticks += is_in_gas
    wanted = full_share if is_in_gas else 1.0
    share += max(-most_change, min(most_change, wanted - share))
    state = {"is_in_gas": is_in_gas, "n_ticks": n_ticks}
    say({"tick": message["tick"], "outputs": {"ventilation": {"share": share}, "state": state}})
