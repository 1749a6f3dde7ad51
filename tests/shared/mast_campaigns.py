"""A small campaign of our own in the format of METEC: masts around two places, one release, wind that turns."""

import json
from datetime import UTC, datetime, timedelta

import numpy as np

from gslcosim_search.fixed_sensors.puff_response import WindRecord, puff_responses

BEGIN = datetime(2030, 5, 1, tzinfo=UTC)
MASTS_M = {"a": (40.0, 0.0), "b": (0.0, 40.0), "c": (-40.0, 0.0), "d": (0.0, -40.0), "e": (28.0, 28.0)}
PLACES_M = {"tank": (-15.0, -10.0), "well": (15.0, 10.0)}
N_MINUTES = 600
FIRST, LAST = 240, 360
# A kilogram of methane at sea level and 288 K.
M3_PER_KG = 1.473
RATE_KG_H = 2.0


def write_campaign(folder, *, place="well", truth=None, rate_kg_h=RATE_KG_H):
    """Write the set; `truth` is the place that the log of releases names, which may be another."""
    folder.mkdir(parents=True)
    rng = np.random.default_rng(1)
    start_s = BEGIN.timestamp() + 60.0 * np.arange(N_MINUTES)
    angle = 0.5 + 0.9 * np.sin(np.arange(N_MINUTES) / 17.0)
    wind_m_s = np.column_stack([2.5 * np.cos(angle), 2.5 * np.sin(angle)])
    masts_m = np.array([[*place_m, 2.4] for place_m in MASTS_M.values()])
    wind = WindRecord.of_means(start_s, wind_m_s, 2.4)
    response = puff_responses(masts_m, wind, np.array([*PLACES_M[place], 2.0]))
    is_open = (np.arange(N_MINUTES) >= FIRST) & (np.arange(N_MINUTES) < LAST)
    readings = 2.0 + rng.normal(0.0, 0.01, response.shape)
    readings += np.where(is_open[:, None], rate_kg_h / 3600.0 * M3_PER_KG * response, 0.0)
    content = {
        kind: {name: {"east_m": x, "north_m": y, "height_m": height_m} for name, (x, y) in places_m.items()}
        for kind, places_m, height_m in (("masts", MASTS_M, 2.4), ("candidate_places", PLACES_M, 2.0))
    }
    (folder / "site.json").write_text(json.dumps(content))
    times = [BEGIN + timedelta(minutes=i) for i in range(N_MINUTES)]
    header = ",".join(["time_utc", "wind_east_m_s", "wind_north_m_s", *(f"ch4_{name}_ppm" for name in MASTS_M)])
    rows = [
        f"{time:%Y-%m-%dT%H:%M:%SZ},{u:.4f},{v:.4f}," + ",".join(f"{x:.3f}" for x in row)
        for time, (u, v), row in zip(times, wind_m_s, readings, strict=True)
    ]
    (folder / "minutes.csv").write_text("\n".join([header, *rows]) + "\n")
    named = truth or place
    x_m, y_m = PLACES_M[named]
    (folder / "releases.csv").write_text(
        "release,start_utc,end_utc,place,east_m,north_m,rate_kg_h\n"
        f"1,{times[FIRST]:%Y-%m-%dT%H:%M:%SZ},{times[LAST]:%Y-%m-%dT%H:%M:%SZ},{named},{x_m},{y_m},{rate_kg_h}\n"
    )
    return folder
