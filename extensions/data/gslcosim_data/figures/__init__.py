"""Figures for papers: functions that draw a run, or what is read from runs, on matplotlib axes.

`docs/plots.md` has a picture of each. `styled` is the style in which `gslcosim plot` draws; `save` writes files that
are the same for the same data. Needs the extra `plot`.
"""

from gslcosim_data.figures.plans import (
    belief,
    gas_on_plan,
    gas_section,
    ground_track,
    plan,
    success_by_start,
    swarm_tracks,
    track_3d,
    tracks_of_runs,
    wind_section,
)
from gslcosim_data.figures.run_figures import (
    belief_quality,
    distance,
    distance_bundle,
    draw_run,
    draw_runs,
    sensor_response,
    true_gas,
    write_figures_of_several,
    write_run_figures,
)
from gslcosim_data.figures.style import new_figure, read_svg_points, save, styled

__all__ = [
    "belief", "belief_quality", "distance", "distance_bundle", "draw_run", "draw_runs", "gas_on_plan", "gas_section",
    "ground_track", "new_figure", "plan", "read_svg_points", "save", "sensor_response", "styled", "success_by_start",
    "swarm_tracks", "track_3d", "tracks_of_runs", "true_gas", "wind_section", "write_figures_of_several",
    "write_run_figures",
]  # fmt: skip
