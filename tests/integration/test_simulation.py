"""`gslcosim.Simulation`: a live run that its caller steps, plays, pauses, resets and looks into."""

import json
import re
from pathlib import Path

import numpy as np
import pytest

import gslcosim
from gslcosim.agent_kit import Command
from gslcosim.base.bundled import bundled_scenarios
from gslcosim.base.errors import UsageError
from gslcosim.cli.main import main

# Ten ticks a second; the beetle searches and holds at waypoints meanwhile.
LASTS = ["referee.stop.time_limit_s=3600", "referee.success.within_m=0.01"]
ATTACHED = [*LASTS, "agents[0].start={attach: true}", "agents[0].mode=lockstep", "agents[0].parameters={}"]


@pytest.mark.slow
def test_single_steps_are_one_long_step_and_a_reset_is_a_fresh_start():
    with gslcosim.Simulation("tiny_room", seed=3, overrides=LASTS) as simulation:
        assert simulation.tick == -1
        assert simulation.step(1000) == 1000
        digest, place_m = simulation.digest, simulation.truth.bodies["beetle"].position_world_m
        simulation.reset()
        assert simulation.tick == -1
        assert [simulation.step() for _ in range(1000)] == [1] * 1000
        assert simulation.digest == digest
        assert simulation.truth.bodies["beetle"].position_world_m == place_m
        simulation.reset(seed=4)
        simulation.step(200)
        other = simulation.digest
    with gslcosim.Simulation("tiny_room", seed=4, overrides=LASTS) as simulation:
        simulation.step(200)
        assert simulation.digest == other


def test_a_run_stepped_to_its_end_has_the_digest_of_up(tmp_path, capsys):
    main(["up", "tiny_room", "--in-process", "--json", "--runs-dir", str(tmp_path)])
    result = json.loads(capsys.readouterr().out)
    with gslcosim.Simulation("tiny_room") as simulation:
        while not simulation.is_over:
            simulation.step(7)
            # Looking changes nothing.
            simulation.truth.gas_ppm([[1.0, 1.0, 1.0]])
            simulation.truth.wind_m_s([1.0, 1.0, 1.0])
        with pytest.raises(UsageError, match="was over"):
            simulation.step()
        assert simulation.digest == result["digest"]
        assert simulation.outcome.verdict.end_reason == result["end_reason"]


def test_an_attached_agent_is_commanded_by_the_caller():
    with gslcosim.Simulation("tiny_room", overrides=ATTACHED) as simulation:
        assert simulation.step(5) == 1
        assert simulation.asked == ("beetle",)
        with pytest.raises(UsageError, match="expected commands for beetle first"):
            simulation.step()
        for _ in range(100):
            seen = simulation.observe()["beetle"]
            kind = {"kind": "waypoint", "position_world_m": (3.0, 2.5, 1.0)} if seen.tick == 0 else {"kind": "noop"}
            simulation.command("beetle", Command(tick=seen.tick, **kind))
            assert simulation.step() == 1
        assert simulation.truth.bodies["beetle"].position_world_m[0] < 4.4
        with pytest.raises(UsageError, match="'moth': beetle are asked"):
            simulation.command("moth", Command(tick=0, kind="noop"))


def test_truth_is_what_sample_says_and_observations_hold_none_of_it(tmp_path):
    rows = [(1.6 + 0.05 * i, 2.0 + 0.01 * i, 1.0) for i in range(20)]
    points = tmp_path / "points.csv"
    points.write_text("x_m,y_m,z_m\n" + "".join(f"{x},{y},{z}\n" for x, y, z in rows))
    with gslcosim.Simulation("tiny_room", seed=3, overrides=LASTS) as simulation:
        simulation.step(51)
        assert simulation.time_s == 5.0
        gas_ppm, wind_m_s = simulation.truth.gas_ppm(rows), simulation.truth.wind_m_s(rows)
        assert set(simulation.observe()) == {"beetle"}
        assert not hasattr(simulation.observe()["beetle"], "truth")
        assert simulation.truth.sources[0].position_m == (1.5, 2.0, 1.0)
        with pytest.raises(UsageError, match=r"points in the room, .* at index 1"):
            simulation.truth.gas_ppm([rows[0], (99.0, 0.0, 0.0)])
        with pytest.raises(UsageError, match="expected one of ethanol"):
            simulation.truth.gas_ppm(rows, gas="methane")
    scenario = tmp_path / "room.yaml"
    scenario.write_text(bundled_scenarios()["tiny_room"].read_text().replace("\nseed: 1\n", "\nseed: 3\n"))
    for quantity, expected in (("gas", gas_ppm[:, None]), ("wind", wind_m_s)):
        out = tmp_path / f"{quantity}.csv"
        words = ["environment", "sample", str(scenario), "--time", "5", "--points", str(points), "--out", str(out)]
        # A folder of runs is there; a whole path is no beginning of a run's name.
        words += ["--runs-dir", str(tmp_path)]
        assert main([*words, "--quantity", quantity]) == 0
        values = np.loadtxt(out, delimiter=",", skiprows=1)[:, 3 : 3 + expected.shape[1]]
        np.testing.assert_allclose(values, expected, rtol=1e-6)
    assert gas_ppm.max() > 0.0


def test_play_and_pause_leave_the_run_as_steps_do():
    with gslcosim.Simulation("tiny_room", seed=3, overrides=LASTS) as simulation:
        simulation.play(pace=20)
        with pytest.raises(UsageError, match="expected a paused simulation"):
            simulation.step()
        while simulation.tick < 5 and simulation.is_playing:
            simulation.observe()
        simulation.pause()
        assert not simulation.is_playing
        n_ticks, digest = simulation.tick + 1, simulation.digest
        simulation.reset()
        simulation.step(n_ticks)
        assert simulation.digest == digest
    with pytest.raises(UsageError, match="was over"):
        simulation.play()


def test_a_run_that_does_not_wait_and_agents_that_are_not_there_are_refused():
    with pytest.raises(UsageError, match="was free"):
        gslcosim.Simulation("tiny_room", overrides=["agents[0].mode=free", "pace=1"])
    with pytest.raises(UsageError, match="expected agents of the scenario"):
        gslcosim.Simulation("tiny_room", commanded=["moth"])


PAGE = (Path(__file__).parents[2] / "docs" / "step.md").read_text()


def test_the_programs_of_the_page_run(capsys):
    names = {}
    for program in re.findall(r"```python\n(.*?)```", PAGE, flags=re.DOTALL):
        exec(program, names)
    assert capsys.readouterr().out.startswith("4.9 ")
    assert names["simulation"].tick == 50
