"""Short runs that together use every core with all its models, for snapshots of them."""

from pathlib import Path

import numpy as np
from real_runs import AROUND_A_WALL, EVERY_VEHICLE, ROOT, TINY_ROOM

SCENARIOS = ROOT / "scenarios"
GAS_SENSORS = ("tgs2602", "pid", "threshold", "binary", "hit_counter", "averaging", "second_order", "tdlas")
ON_BOARD = (
    "{model: imu, name: imu}",
    "{model: gps, name: gps, period_s: 0.2, delay_s: 0.1}",
    "{model: barometer, name: barometer, noise_std: 1, drift_per_s: 0.1}",
    "{model: magnetometer, name: compass, noise_std: 0.1}",
    "{model: pose, name: pose}",
    "{model: range_finder, name: below, beam_body: [0, 0, -1], max_range_m: 4, noise_std: 0.01}",
    "{model: four_range_finders, name: around, max_range_m: 4, noise_std: 0.01}",
    "{model: lidar_2d, name: scan, period_s: 0.2, lidar: {n_azimuths: 36}}",
    "{model: lidar_3d, name: cloud, period_s: 1, noise_std: 0.02, lidar: {n_azimuths: 36, n_elevations: 4}}",
    "{model: bump, name: bumper, period_s: 0.3}",
)
NOSES = "[{model: tgs2600, name: nose}, {model: anemometer, name: wind}"


def _set(*values: str) -> tuple[str, ...]:
    return tuple(word for value in values for word in ("--set", value))


def _sensors(*blocks: str) -> tuple[str, ...]:
    return _set(f"agents[0].sensors={NOSES}, {', '.join(blocks)}]")


def _release(text: str) -> tuple[str, ...]:
    return _set(f"gas.sources[0].release={text}")


_SPARED = _set("referee.success.within_m=0.05")

CASES: dict[str, tuple[Path, tuple[str, ...]]] = {
    "filaments": (TINY_ROOM, ()),
    "tape": (TINY_ROOM, _set("gas.tape=true")),
    "poisson": (TINY_ROOM, _release("{kind: poisson}")),
    "variable": (TINY_ROOM, _release("{kind: variable, interval_s: 0.7}")),
    "intermittent": (TINY_ROOM, _release("{kind: intermittent, on_s: 0.9, off_s: 1.3}")),
    "scheduled": (TINY_ROOM, _release("{kind: scheduled, schedule: [[0, 20], [21, 3], [24, 15]]}")),
    "downwash": (TINY_ROOM, _set("gas.rotor_downwash=true")),
    "gaussian_plume": (TINY_ROOM, _set("gas.model=gaussian_plume")),
    "meandering_plume": (TINY_ROOM, _set("gas.model=meandering_plume")),
    "farrell": (TINY_ROOM, _set("gas.model=farrell", "gas.farrell={}", "wind.solver=uniform")),
    "gas_sensors": (
        TINY_ROOM,
        _sensors(*(f"{{model: {m}, name: {m}, noise_std: 0.01, delay_s: 0.2}}" for m in GAS_SENSORS)),
    ),
    "on_board": (TINY_ROOM, _sensors(*ON_BOARD)),
    "lockstep": (TINY_ROOM, (*_SPARED, *_set("agents[0].mode=lockstep", "referee.stop.time_limit_s=8"))),
    "latency": (TINY_ROOM, (*_SPARED, *_set("agents[0].mode={latency: 3}", "referee.stop.time_limit_s=8"))),
    "vehicles": (EVERY_VEHICLE, ()),
    "avoidance": (AROUND_A_WALL, ()),
    "swarm": (SCENARIOS / "swarm_tiny.yaml", ()),
    "event_source": (SCENARIOS / "event_source.yaml", ()),
    "event_sensor": (SCENARIOS / "event_sensor.yaml", ()),
    "event_rotor": (SCENARIOS / "event_rotor.yaml", ()),
    "event_radio": (SCENARIOS / "event_radio.yaml", ()),
}


def write_movie(folder: Path) -> tuple[str, ...]:
    """Write a movie of the tiny room's gas, and return what lets the room play it."""
    ppm = np.random.default_rng(1).random((40, 12, 10, 6)) * 5.0
    path = folder / "movie.npz"
    np.savez(path, time_s=np.arange(40) * 0.7, mixing_ratio_ppm=ppm, origin_m=np.zeros(3), cell_m=np.array(0.5))
    return _set("gas.model=playback", f"gas.playback={{folder: {path}, loop: true}}")
