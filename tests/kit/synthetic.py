"""Folders of results of any size with known truths, drawn by a seed: nothing is run."""

import base64
import hashlib
import json
import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from gslcosim_bench.store import TRACKS, TRIALS

LIMIT_S = 300.0
WITHIN_M = 1.0
ROOM_M = 15.0
HEIGHT_M = 2.0
SOURCE_M = (5.0, 1.0, 2.0)
STARTS_M = ((3, 3), (7.5, 3), (12, 3), (3, 7.5), (7.5, 7.5), (12, 7.5), (3, 12), (7.5, 12), (12, 12))


@dataclass(frozen=True, kw_only=True)
class Method:
    """What is true of an entry.

    `success` is its rate in an easy room, of which each further room takes `harder`; `mean_s` its mean time to the
    source; `luck` its rate without gas; `confidence` its mean when it declares the source.
    """

    name: str
    success: float = 0.5
    mean_s: float = 120.0
    luck: float = 0.1
    declares: float = 0.0
    confidence: float = 0.8
    crashes: float = 0.0
    has_belief: bool = False
    faults: float = 0.0


ORACLE = Method(name="oracle", success=1.0, mean_s=25.0, luck=1.0)
WALKER = Method(name="random_walker", success=0.2, mean_s=170.0, luck=0.2)
USUAL = (
    Method(name="surge_cast", success=0.75, mean_s=90.0, luck=0.15),
    Method(name="e_coli", success=0.3, mean_s=150.0, luck=0.2, crashes=0.05),
    Method(name="infotaxis", success=0.85, mean_s=110.0, luck=0.12, declares=0.9, has_belief=True),
    Method(name="dung_beetle", success=0.5, mean_s=130.0, luck=0.1, faults=0.03),
)


@dataclass(frozen=True, kw_only=True)
class Plan:
    """What the folder holds."""

    methods: tuple[Method, ...] = (*USUAL, ORACLE, WALKER)
    n_scenarios: int = 2
    n_families: int = 2
    starts_m: tuple[tuple[float, float], ...] = STARTS_M
    repetitions: int = 5
    controls_frac: float = 0.4
    harder: float = 0.15
    maps: bool = True
    tracks: bool = True
    n_points: int = 60
    seed: int = 7
    title: str = "A suite that was never flown"
    question: str = "Does the page say what the rows say?"
    missing: int = field(default=0)


def many(n: int) -> tuple[Method, ...]:
    """Return so many entries, from bad to good."""
    rates = np.linspace(0.05, 0.95, n)
    return tuple(Method(name=f"entry_{i:02d}", success=float(rate)) for i, rate in enumerate(rates))


def make_results(folder: Path, plan: Plan = Plan()) -> Path:
    """Write a folder of results and return it."""
    folder.mkdir(parents=True, exist_ok=True)
    rng = np.random.default_rng(plan.seed)
    rows, tracks = [], []
    for i_scenario in range(plan.n_scenarios):
        for start_m in plan.starts_m:
            for is_control in (False, True):
                n = round(plan.repetitions * plan.controls_frac) if is_control else plan.repetitions
                for repetition in range(n):
                    for method in plan.methods:
                        row, track = _flown(plan, method, i_scenario, start_m, repetition, rng, is_control=is_control)
                        rows.append(row)
                        tracks.append(track)
    n_planned = len(rows)
    if plan.missing:
        rows, tracks = rows[: -plan.missing], tracks[: -plan.missing]
    pq.write_table(pa.Table.from_pylist(rows, schema=TRIALS), folder / "trials.parquet")
    if plan.tracks:
        pq.write_table(_table_of(tracks), folder / "tracks.parquet")
    if plan.maps:
        maps = [_map(scenario_name(i), rng) for i in range(plan.n_scenarios)]
        (folder / "maps.json").write_text(json.dumps({"schema": "gslcosim/maps/1", "maps": maps}))
    (folder / "manifest.json").write_text(json.dumps(_manifest(plan, n_planned), indent=2))
    (folder / "suite.yaml").write_text(f"schema: gslcosim/suite/1\nname: synthetic\nrepetitions: {plan.repetitions}\n")
    return folder


def _table_of(tracks: list[dict]) -> pa.Table:
    offsets = np.concatenate([[0], np.cumsum([len(track["t_s"]) for track in tracks])]).astype(np.int32)
    columns = [
        pa.array([track[name] for track in tracks])
        if name in ("trial", "agent")
        else pa.ListArray.from_arrays(offsets, np.concatenate([np.zeros(0, np.float32), *(t[name] for t in tracks)]))
        for name in TRACKS.names
    ]
    return pa.Table.from_arrays([column.cast(kind) for column, kind in zip(columns, TRACKS.types)], schema=TRACKS)


def scenario_name(index: int) -> str:
    """Return the name of a room."""
    return f"room_{index + 1}"


def _flown(plan, method, i_scenario, start_m, repetition, rng, *, is_control):
    scenario, start = scenario_name(i_scenario), f"{start_m[0]:g},{start_m[1]:g}"
    varied = json.dumps({"agents[0].vehicle.start_m": [*start_m, HEIGHT_M]})
    key = f"{scenario}/{start}/{repetition}/{method.name}/{is_control}"
    trial = hashlib.sha256(key.encode()).hexdigest()[:16]
    distance_m = float(np.hypot(start_m[0] - SOURCE_M[0], start_m[1] - SOURCE_M[1]))
    rate = (
        method.luck
        if is_control
        else max(0.0, method.success - (plan.harder * i_scenario if method != ORACLE else 0.0))
    )
    crashed, faulty = rng.random() < method.crashes, rng.random() < method.faults
    success = bool(rng.random() < rate) and not crashed and not faulty
    shortest_m = max(distance_m - WITHIN_M, 0.1)
    time_s = float(min(shortest_m + rng.gamma(2.0, method.mean_s / 2.0), LIMIT_S - 0.5)) if success else LIMIT_S
    path_m = shortest_m * (1.0 if method == ORACLE else 1.0 + rng.exponential(2.0)) if success else 0.6 * LIMIT_S
    declared = bool(rng.random() < (method.declares if success else method.declares * 0.3)) and not faulty
    error_m = float(rng.exponential(0.4 if success and not is_control else 4.0)) if declared else None
    false = int(declared and (is_control or (error_m or 0.0) > WITHIN_M))
    nearest_m = float(rng.uniform(0.2, WITHIN_M)) if success else float(rng.uniform(WITHIN_M, 6.0))
    score = 0.0 if crashed or not success else (1.0 - 0.5 * time_s / LIMIT_S) * 0.5**false
    confidence = float(np.clip(rng.normal(method.confidence - (0.3 if is_control else 0.0), 0.15), 0.01, 1.0))
    end_s = time_s if success else (float(rng.uniform(5, LIMIT_S)) if crashed or faulty else LIMIT_S)
    near = float(np.clip(rng.beta(6, 2) if success else rng.beta(1, 5), 0, 1))
    row = {
        "trial": trial, "case": f"{scenario}/start={start}", "scenario": scenario,
        "family": f"family_{i_scenario % plan.n_families + 1}", "varied": varied, "repetition": repetition,
        "entry": method.name, "is_control": is_control, "seed": 1000 + repetition, "gas_seed": repetition % 3,
        "knows": "source" if method == ORACLE else "", "sensors": "tgs2600+anemometer", "n_robots": 1,
        "environment_hash": f"{i_scenario:064x}", "time_limit_s": LIMIT_S, "within_m": WITHIN_M, "success_of": "source",
        "start_x_m": float(start_m[0]), "start_y_m": float(start_m[1]), "start_z_m": HEIGHT_M,
        "source_x_m": SOURCE_M[0], "source_y_m": SOURCE_M[1], "source_z_m": SOURCE_M[2],
        "status": "crashed" if faulty else "flown", "fault": "",
        "agent_faults": "decide() raised ZeroDivisionError: division by zero" if faulty else "",
        "digest": "" if faulty else hashlib.sha256(trial.encode()).hexdigest(),
        "outcome": "agent_failed" if faulty else "success" if success else "collision" if crashed else "time_limit",
        "success": success, "time_to_source_s": time_s if success else None, "time_s": time_s, "end_s": end_s,
        "score": score, "share_arrived": float(success), "steps": int(end_s / 3), "path_length_m": path_m,
        "total_path_length_m": path_m, "shortest_path_m": shortest_m,
        "travel_overhead": path_m / shortest_m - 1 if success else None,
        "spl": shortest_m / max(path_m, shortest_m) if success else 0.0, "directness": float(rng.uniform(-0.2, 0.9)),
        "nearest_m": nearest_m,
        **{f"time_within_{name}_m_s": _first_within(radius_m, nearest_m, distance_m, end_s)
           for name, radius_m in (("5", 5.0), ("2", 2.0), ("1", 1.0), ("05", 0.5))},
        "n_collisions": int(crashed), "n_refusals": int(rng.integers(0, 3)),
        "first_contact_s": None if is_control else float(rng.uniform(0, 60)),
        "tracking_ratio": None if is_control else float(rng.uniform(0, 0.6)), "declared": declared,
        "first_declared_s": end_s * 0.95 if declared else None, "declared_confidence": confidence if declared else 0.0,
        "declared_error_m": error_m, "declared_error_in_plane_m": error_m, "n_false_declarations": false,
        "belief_distance_m": float((1 - near) * 8) if method.has_belief else None,
        "belief_error_m": float((1 - near) * 7) if method.has_belief else None,
        "belief_mass_near": near if method.has_belief else None,
        "belief_entropy_bits": float((1 - near) * 10) if method.has_belief else None,
        "belief_minus_log_p": float(-np.log(max(near, 1e-3) / 4)) if method.has_belief else None,
        "wall_decision_p50_ms": float(rng.uniform(0.05, 0.2)), "wall_decision_p95_ms": float(rng.uniform(0.3, 0.9)),
        "wall_preparing_s": 0.02, "wall_starting_s": 0.1, "wall_flying_s": float(rng.uniform(1, 2)),
        "wall_judging_s": 0.01, "wall_storing_s": 0.002, "wall_worker": f"local-{repetition % 2}",
    }  # fmt: skip
    return row, _track(plan, method, row, start_m, near, rng)


def _first_within(radius_m: float, nearest_m: float, start_m: float, end_s: float) -> float | None:
    if nearest_m > radius_m:
        return None
    return end_s * float(np.clip((start_m - radius_m) / max(start_m - nearest_m, 0.1), 0, 1))


def _track(plan, method, row, start_m, near, rng):
    n, end_s = plan.n_points, row["end_s"]
    t = np.linspace(0.0, end_s, n)
    goal = np.asarray(SOURCE_M[:2]) + (0.3 if row["success"] else rng.uniform(2, 9, 2) * (1, 1))
    track = np.asarray(start_m) + np.linspace(0, 1, n)[:, None] * (goal - start_m)
    noise = np.cumsum(rng.normal(0, 0.0 if method == ORACLE else 0.35, (n, 2)), axis=0)
    noise -= noise[0] + np.linspace(0, 1, n)[:, None] * (noise[-1] - noise[0])
    xy = np.clip(track + noise, 0.3, ROOM_M - 0.3)
    distance_m = np.hypot(*(xy - SOURCE_M[:2]).T)
    gas = np.zeros(n) if row["is_control"] else _gas_ppm(xy[:, 0], xy[:, 1])
    share = np.linspace(0, 1, n)
    mass = near * share if method.has_belief else np.full(n, np.nan)
    series = {
        "t_s": t, "x_m": xy[:, 0], "y_m": xy[:, 1], "z_m": np.full(n, HEIGHT_M), "distance_m": distance_m,
        "gas_ppm": gas, "reading": gas * 1.1, "belief_distance_m": 8 * (1 - mass), "belief_mass_near": mass,
    }  # fmt: skip
    return {"trial": row["trial"], "agent": "agent_0", **{k: v.astype(np.float32) for k, v in series.items()}}


def _gas_ppm(x, y):
    along = np.maximum(x - SOURCE_M[0] + 0.3, 0.0)
    width = 0.4 + 0.18 * along
    return np.where(along > 0, 20 / (1 + along) * np.exp(-0.5 * ((y - SOURCE_M[1] - 0.35 * along) / width) ** 2), 0.0)


def _map(scenario: str, rng: np.random.Generator) -> dict:
    cell_m, n = 0.2, 75
    x, y = np.meshgrid((np.arange(n) + 0.5) * cell_m, (np.arange(n) + 0.5) * cell_m, indexing="ij")
    occupied = np.zeros((n, n), np.uint8)
    occupied[[0, -1], :] = occupied[:, [0, -1]] = 1
    for x0 in rng.choice(np.arange(15, 60, 15), 2, replace=False):
        occupied[x0 : x0 + 4, 25:50] = 1
    gas = np.where(occupied == 0, _gas_ppm(x, y), 0.0).astype("<f4")
    # Along the plume's axis.
    toward = np.broadcast_to(np.array([1.0, 0.35]) / math.hypot(1.0, 0.35), (n, n, 2)).astype("<f4")
    return {
        "scenario": scenario, "varied": "{}", "environment_hash": "0" * 64, "height_m": HEIGHT_M,
        "origin_m": [0.0, 0.0],
        "cell_m": cell_m, "shape": [n, n], "occupied": _base64(occupied), "mean_gas_ppm": _base64(gas),
        "intermittency": _base64((gas > 1).astype("<f4")), "wind_toward": _base64(toward),
        "sources_m": [list(SOURCE_M)],
    }  # fmt: skip


def _base64(values: np.ndarray) -> str:
    return base64.b64encode(values.tobytes()).decode()


def _manifest(plan: Plan, n_planned: int) -> dict:
    names: Sequence[str] = [method.name for method in plan.methods]
    anchors = {k: v for k, v in (("lower", "oracle"), ("upper", "random_walker")) if v in names}
    return {
        "schema": "gslcosim/results/1", "suite": "synthetic", "suite_hash": "ab" * 32, "title": plan.title,
        "question": plan.question, "versions": {"gslcosim": "0.1.0", "python": "3.11.2", "numpy": "2.1.0"},
        "software_hash": "cd" * 32,
        "machine": {"cpu": "a processor", "cores": 2, "platform": "Linux", "reference_loop_s": 0.5},
        "entries": [
            {"name": name, "title": name.replace("_", " "), "family": "bundled", "agent_hash": "ef" * 32,
             "blind": name in ("sweep", "random_walker"),
             "language": "python", "parameters": {"step_m": 0.5}, "knows": "source" if name == "oracle" else ""}
            for name in names
        ],
        "scenarios": [
            {"name": scenario_name(i), "family": f"family_{i % plan.n_families + 1}", "title": f"Room {i + 1}"}
            for i in range(plan.n_scenarios)
        ],
        "n_planned": n_planned, "n_dropped": 1,
        "dropped": [{"case": "room_1/start=5,5", "reason": "the start is in a rack"}], "anchors": anchors,
        "wall": {"started_at": "2026-01-01T00:00:00+00:00", "total_s": 600.0, "preparing_s": 60.0, "flying_s": 540.0,
                 "busy_share": 0.95, "jobs": 2},
        "recordings": {},
    }  # fmt: skip


def unpack_track(text: str, quanta: Sequence[float]) -> tuple[np.ndarray, np.ndarray]:
    """Return the times [s] and places [m] of a track as pages have it."""
    values, value, shift = [], 0, 0
    for byte in base64.b64decode(text):
        value |= (byte & 127) << shift
        shift += 7
        if byte < 128:
            values.append(-(value + 1) // 2 if value % 2 else value // 2)
            value = shift = 0
    points = np.cumsum(np.array(values).reshape(-1, 3), axis=0)
    return points[:, 0] * quanta[0], points[:, 1:] * quanta[1]
