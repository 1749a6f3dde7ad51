"""A small set of lasers of our own in the format of Chilbolton: two beams, one source, gas in the first half hour."""

import json

LAYOUT = {
    "instrument_m": [60, 0, 1.6],
    "reflectors_m": {"reflector_1": [60, 60, 1.6], "reflector_2": [10, -50, 1.6]},
}
COLUMNS = (
    "release,clock_time,wind_x_m_s,wind_y_m_s,wind_z_m_s,wind_x_std_m_s,wind_y_std_m_s,wind_z_std_m_s,"
    "air_temperature_k,pressure_pa,tan_gamma_horizontal,tan_gamma_vertical,ch4_beam_1_ppm,ch4_beam_2_ppm"
)


def write_lasers(folder, source="source_5", *, tan_gammas=(0.2,) * 60):
    """Write the set, with a minute for each tangent of the scatter of directions."""
    folder.mkdir(parents=True)
    layout = {**LAYOUT, "sources": {source: {"place_m": [30, 30, 0.3], "rate_kg_s": 4e-4}}}
    (folder / "layout.json").write_text(json.dumps(layout))
    rows = [
        f"r1,2030-01-01T10:{minute:02d}:00,{2 if minute < 30 else -2},0,0,.5,.5,.3,290,101325,{tan_gamma},.1,"
        f"{3.5 if minute < 30 else 2.0},2.0"
        for minute, tan_gamma in enumerate(tan_gammas)
    ]
    (folder / f"minutes_{source}.csv").write_text("\n".join([COLUMNS, *rows]) + "\n")
    return folder
