"""From a suite file to its trials: what varies, what is shared, what is refused."""

import json
from pathlib import Path

import pytest

from gslcosim.base.errors import ScenarioError, UsageError
from gslcosim.methods.card import SHARED_PARAMETERS
from gslcosim_archive.sealing import hash_recipe
from gslcosim_bench.cases import Plan, build_plan, load_suite, suite_files
from gslcosim_bench.cases.models import Selection, Shard, choose_trials, derive_seed
from gslcosim_bench.cases.plan import build_plan_of_rows, group_settings
from gslcosim_bench.cases.spec_files import find_scenario_beside

HEAD = "schema: gslcosim/suite/1\nname: mine\nanchors: []\n"
ONE_ENTRY = "entries: [{name: beetle, start: {python: dung_beetle}}]\n"


def planned(folder: Path, text: str, *, seed: int | None = None) -> Plan:
    (folder / "suite.yaml").write_text(HEAD + text)
    return build_plan(load_suite(folder / "suite.yaml", seed=seed))


def test_vary_multiplies_and_lists_of_one_item_go_together(tmp_path: Path) -> None:
    plan = planned(
        tmp_path,
        "scenarios: [tiny_room]\n"
        "vary:\n"
        "  - agents[0].vehicle.hold_s: [0.5, 1.0]\n"
        "  - {'agents[0].vehicle.search_height_m': [1.0, 1.5], referee.success.within_m: [0.8, 0.9]}\n"
        "repetitions: 3\n" + ONE_ENTRY,
    )
    assert [case.name for case in plan.cases] == [
        "tiny_room/hold=0.5/search_height=1/within=0.8",
        "tiny_room/hold=0.5/search_height=1.5/within=0.9",
        "tiny_room/hold=1/search_height=1/within=0.8",
        "tiny_room/hold=1/search_height=1.5/within=0.9",
    ]
    assert len(plan.trials) == 12
    assert len({trial.id for trial in plan.trials}) == 12
    assert [trial.index for trial in plan.trials] == list(range(12))
    last = plan.trials[-1].resolved
    assert (last.agents[0].vehicle.hold_s, last.referee.success.within_m) == (1.0, 0.9)


def test_labels_stand_beside_values_and_change_no_trial(tmp_path: Path) -> None:
    bare = planned(tmp_path, "scenarios: [tiny_room]\nvary: [{'wind.inlet_velocity_m_s': [[1, 0, 0]]}]\n" + ONE_ENTRY)
    labelled = planned(
        tmp_path,
        "set: {labels.gas: neutral, labels.wind: slow}\n"
        "scenarios: [{source: tiny_room, set: {labels.room: tiny}}]\n"
        "vary: [{labels.wind: [fast], 'wind.inlet_velocity_m_s': [[1, 0, 0]]}]\n" + ONE_ENTRY,
    )
    assert [trial.id for trial in labelled.trials] == [trial.id for trial in bare.trials]
    assert labelled.cases[0].name == bare.cases[0].name
    assert json.loads(labelled.trials[0].varied) == {
        "labels.gas": "neutral", "labels.wind": "fast", "labels.room": "tiny",
        "wind.inlet_velocity_m_s": [1, 0, 0],
    }  # fmt: skip


OWN_AXES = """
scenarios:
  - {source: tiny_room, starts: [[4.5, 2.5, 0.2], [4.5, 1, 0.2]], repetitions: 2, gas_seeds: 1}
  - source: tiny_room
    name: slow
    set: {'wind.inlet_velocity_m_s': [0.2, 0, 0]}
    vary: [{'agents[0].vehicle.search_height_m': [1.2]}]
    seeds: [11, 12, 13]
vary:
  - agents[0].vehicle.search_height_m: [1.0, 1.8]
"""


def test_scenarios_of_a_suite_have_starts_values_and_seeds_of_their_own(tmp_path: Path) -> None:
    plan = planned(tmp_path, OWN_AXES + ONE_ENTRY)
    assert [case.name for case in plan.cases] == [
        "tiny_room/search_height=1/start=4.5,2.5,0.2",
        "tiny_room/search_height=1/start=4.5,1,0.2",
        "tiny_room/search_height=1.8/start=4.5,2.5,0.2",
        "tiny_room/search_height=1.8/start=4.5,1,0.2",
        "slow/search_height=1.2",
    ]
    first, slow = ([t for t in plan.trials if t.scenario == name] for name in ("tiny_room", "slow"))
    assert len(first) == 8
    assert len({t.resolved.gas.seed for t in first}) == 1
    assert [(t.resolved.seed, t.resolved.gas.seed) for t in slow] == [(11, 11), (12, 12), (13, 13)]
    assert slow[0].resolved.agents[0].vehicle.search_height_m == 1.2


@pytest.mark.parametrize(
    ("before", "after", "problem"),
    [
        ("seeds: [11, 12, 13]", "seeds: [11, 11]", r"scenarios\[1\].seeds: expected each seed once, was 11 twice"),
        ("seeds: [", "repetitions: 3\n    seeds: [", r"scenarios\[1\].seeds: expected seeds .* was repetitions too"),
        (
            "repetitions: 2,",
            "vary: [{'agents[0].vehicle.start_m': [[1, 1, 1]]}],",
            r"scenarios\[0\].starts: expected each value to vary in one place, was agents\[0\].vehicle.start_m in two",
        ),
        (
            "search_height_m: [1.0, 1.8]",
            "search_height_m: [1.0, 1.8]\n    gas.step_s: [0.1, 0.2]",
            r"scenarios\[1\].vary: expected all values of an item .* Vary gas.step_s in this scenario too",
        ),
    ],
)
def test_what_contradicts_in_a_scenario_of_a_suite_is_refused(
    tmp_path: Path, before: str, after: str, problem: str
) -> None:
    with pytest.raises(ScenarioError, match=problem):
        planned(tmp_path, OWN_AXES.replace(before, after) + ONE_ENTRY)


def test_entries_of_a_case_and_repetition_meet_the_same(tmp_path: Path) -> None:
    entries = (
        "entries:\n  - {name: beetle, start: {python: dung_beetle}}\n  - {name: walk, start: {python: random_walker}}\n"
    )
    plan = planned(tmp_path, "scenarios: [tiny_room]\nrepetitions: 4\n" + entries)
    for repetition in range(4):
        beetle, walk = (trial for trial in plan.trials if trial.repetition == repetition)
        assert beetle.case_hash == walk.case_hash
        assert beetle.resolved.seed == walk.resolved.seed
        assert beetle.resolved.gas == walk.resolved.gas
        assert beetle.id != walk.id
    assert len({trial.resolved.seed for trial in plan.trials}) == 4


def test_controls_have_no_gas_and_the_same_seeds(tmp_path: Path) -> None:
    plan = planned(tmp_path, "scenarios: [tiny_room]\nrepetitions: 4\ncontrols: {no_source_frac: 0.5}\n" + ONE_ENTRY)
    controls = [trial for trial in plan.trials if trial.is_control]
    assert [trial.repetition for trial in controls] == [0, 1]
    for control in controls:
        with_gas = next(t for t in plan.trials if t.repetition == control.repetition and not t.is_control)
        assert control.resolved.seed == with_gas.resolved.seed
        assert control.resolved.gas.sources[0].release.schedule == ((0.0, 0.0),)
        assert control.case_hash != with_gas.case_hash


def test_seeds_are_of_suite_case_and_repetition(tmp_path: Path) -> None:
    text = "scenarios: [tiny_room]\nrepetitions: 2\n" + ONE_ENTRY
    first, again, other = (planned(tmp_path, text, seed=seed) for seed in (5, 5, 6))
    assert [t.id for t in first.trials] == [t.id for t in again.trials]
    assert not {t.resolved.seed for t in first.trials} & {t.resolved.seed for t in other.trials}
    assert first.suite_hash != other.suite_hash
    assert derive_seed(5, "tiny_room", 1) == first.trials[1].resolved.seed
    assert all(0 <= derive_seed(i, "x") < 2**31 for i in range(100))


def test_the_cases_hash_does_not_depend_on_who_enters(tmp_path: Path) -> None:
    cases = "scenarios: [tiny_room]\nrepetitions: 2\n"
    other = "entries: [{name: walk, start: {python: random_walker}, knows: {map: true}, robots: 1}]\n"
    assert planned(tmp_path, cases + ONE_ENTRY).suite_hash == planned(tmp_path, cases + other).suite_hash


def test_drawn_sources_have_the_height_of_their_scenario_and_stay_in_air(tmp_path: Path) -> None:
    text = (
        "scenarios: [{source: gsl_bench_3, source_height_m: 0.3}, {source: gsl_bench_3, name: free}]\n"
        "set: {'gas.sources': [{position_m: random}], 'agents[0].vehicle.start_m': random}\nrepetitions: 12\n"
    )
    plan, again = (planned(tmp_path, text + ONE_ENTRY) for _ in range(2))
    low, free = (
        [trial.resolved.gas.sources[0].position_m for trial in plan.trials if trial.scenario == name]
        for name in ("gsl_bench_3", "free")
    )
    assert {place_m[2] for place_m in low} == {0.3}
    assert len(set(low)) == 12
    assert len({place_m[2] for place_m in free}) > 3
    assert [trial.id for trial in again.trials] == [trial.id for trial in plan.trials]


def test_a_height_without_air_is_refused(tmp_path: Path) -> None:
    text = "scenarios: [{source: tiny_room, source_height_m: 9}]\nset: {'gas.sources': [{position_m: random}]}\n"
    with pytest.raises(ScenarioError, match=r"gas.sources\[0\].position_m: expected a room with free air"):
        planned(tmp_path, text + ONE_ENTRY)


def test_what_a_scenario_grants_is_granted_to_all_but_the_source(tmp_path: Path) -> None:
    text = (
        "scenarios: [{source: tiny_room, set: {'agents[0].knows': {map: 3d, source: true}}}, "
        "{source: tiny_room, name: bare}]\n"
        "entries:\n"
        "  - {name: walk, start: {python: random_walker}}\n"
        "  - {name: mapper, start: {python: gr_gsl}, sensors: by_method}\n"
        "  - {name: own, start: {python: random_walker}, knows: {plume: true}}\n"
    )
    granted = {(t.scenario, t.entry): t.resolved.agents[0].knows for t in planned(tmp_path, text).trials}
    assert {granted["tiny_room", name].map for name in ("walk", "mapper")} == {"3d"}
    assert not any(granted["tiny_room", name].source for name in ("walk", "mapper", "own"))
    assert not granted["tiny_room", "own"].map
    assert not granted["bare", "walk"].map
    assert granted["bare", "mapper"].map


def test_controls_close_the_sources_of_the_gas_to_find_and_leave_decoys(tmp_path: Path) -> None:
    text = (
        "scenarios: [tiny_room]\ncontrols: {no_source_frac: 1}\n"
        "set: {'gas.sources': [{position_m: [1.5, 2, 1]}, {position_m: [3, 2, 1], gas: propanol}]}\n"
    )
    (control,) = (trial for trial in planned(tmp_path, text + ONE_ENTRY).trials if trial.is_control)
    assert [source.release.kind for source in control.resolved.gas.sources] == ["scheduled", "constant"]


def test_nulls_are_entries_of_the_suite(tmp_path: Path) -> None:
    text = "scenarios: [tiny_room]\n" + ONE_ENTRY + "nulls: "
    assert planned(tmp_path, f"{text}[beetle]").loaded.suite.nulls == ("beetle",)
    with pytest.raises(ScenarioError, match="nulls: expected names of entries of the suite, was sweep"):
        planned(tmp_path, f"{text}[sweep]")


def test_places_that_are_not_free_are_errors_unless_they_are_to_be_left_out(tmp_path: Path) -> None:
    text = (
        "scenarios: [tiny_room]\nvary:\n  - agents[0].vehicle.start_m: [[4.5, 2.5, 0.2], [99, 2.5, 0.2]]\n" + ONE_ENTRY
    )
    with pytest.raises(ScenarioError, match=r"scenarios\[0\] tiny_room: agents\[0\].vehicle.start_m"):
        planned(tmp_path, text)
    plan = planned(tmp_path, text + "when: places_are_free\n")
    assert [case.name for case in plan.cases] == ["tiny_room/start=4.5,2.5,0.2"]
    (dropped,) = plan.dropped
    assert dropped.case == "tiny_room/start=99,2.5,0.2"
    assert "start_m" in dropped.reason


def test_a_start_that_is_not_free_may_be_moved_a_little(tmp_path: Path) -> None:
    text = "scenarios: [tiny_room]\nset: {'agents[0].vehicle.start_m': [0.2, 2.5, 0.2]}\n" + ONE_ENTRY
    with pytest.raises(ScenarioError, match="start_m"):
        planned(tmp_path, text + "move_starts_up_to_m: 0.05\n")
    plan = planned(tmp_path, text + "move_starts_up_to_m: 0.5\n")
    (moved,) = plan.moved
    assert moved.from_m == (0.2, 2.5, 0.2)
    assert plan.trials[0].resolved.agents[0].vehicle.start_m == moved.to_m != moved.from_m


def test_an_included_suite_brings_its_cases_and_the_outer_one_its_entries(tmp_path: Path) -> None:
    plan = planned(tmp_path, "include: [smoke]\n" + ONE_ENTRY)
    smoke = build_plan(load_suite("smoke"))
    assert plan.suite_hash == smoke.suite_hash
    assert {trial.entry for trial in plan.trials} == {"beetle"}
    both = planned(tmp_path, "include: [smoke]\n")
    assert {trial.entry for trial in both.trials} == {"dung_beetle", "oracle", "random_walker"}


def test_a_team_stands_around_the_first_robot_and_shares_a_process(tmp_path: Path) -> None:
    entry = "entries: [{name: walkers, start: {python: random_walker}, robots: 3, radio: true}]\n"
    (trial,) = planned(tmp_path, "scenarios: [tiny_room]\n" + entry).trials
    scenario = trial.resolved
    assert [agent.name for agent in scenario.agents] == ["beetle", "robot_2", "robot_3"]
    assert [agent.start.process_of for agent in scenario.agents] == [None, "beetle", "beetle"]
    assert len(scenario.channels) == 1
    assert len({agent.vehicle.start_m for agent in scenario.agents}) == 3


def test_parameters_may_differ_from_scenario_to_scenario(tmp_path: Path) -> None:
    entry = (
        "entries:\n  - name: beetle\n    start: {python: dung_beetle}\n    parameters: {leg_m: 0.5}\n"
        "    parameters_in: {warehouse_empty: {leg_m: 1.0}}\n"
    )
    plan = planned(tmp_path, "scenarios: [tiny_room, warehouse_empty]\n" + entry)
    assert [t.resolved.agents[0].parameters["leg_m"] for t in plan.trials] == [0.5, 1.0]


def test_two_entries_with_programs_in_one_folder_are_two(tmp_path: Path) -> None:
    program = (
        "from gslcosim.agent_kit import Agent\nclass One(Agent):\n"
        "    def __init__(self, briefing): pass\n    def decide(self, observation): raise RuntimeError\n"
    )
    (tmp_path / "a.py").write_text(program)
    (tmp_path / "b.py").write_text(program)
    entries = "entries: [{name: a, start: {python: a.py}}, {name: b, start: {python: b.py}}]\n"
    before = planned(tmp_path, "scenarios: [tiny_room]\n" + entries)
    assert len({trial.id for trial in before.trials}) == 2
    (tmp_path / "a.py").write_text(program + "# changed\n")
    after = planned(tmp_path, "scenarios: [tiny_room]\n" + entries)
    assert before.trials[0].id != after.trials[0].id


WRONG = {
    "an unknown key": ("scenarios: [tiny_room]\nrepetition: 3\n" + ONE_ENTRY, "Did you mean repetitions?"),
    "no scenarios": (ONE_ENTRY, "scenarios: expected at least one scenario"),
    "no entries": ("scenarios: [tiny_room]\n", "entries: expected at least one entry"),
    "lists of other lengths": (
        "scenarios: [tiny_room]\nvary: [{seed: [1, 2], tick_ms: [100]}]\n" + ONE_ENTRY,
        "lists of one length",
    ),
    "a name twice": (
        "scenarios: [tiny_room]\nentries: [{name: a, start: {python: oracle}}, {name: a, start: {python: oracle}}]\n",
        "a twice",
    ),
    "a scenario that is not there": ("scenarios: [tiny_rom]\n" + ONE_ENTRY, "Did you mean tiny_room?"),
    "a path that leads nowhere": (
        "scenarios: [tiny_room]\nset: {'agents[3].vehicle.hold_s': 1}\n" + ONE_ENTRY,
        r"scenarios[0] tiny_room: agents[3].vehicle.hold_s: expected an index below 1",
    ),
    "a value that is wrong": (
        "scenarios: [tiny_room]\nvary: [{'agents[0].vehicle.hold_s': [-1]}]\n" + ONE_ENTRY,
        "agents[0].vehicle.hold_s: expected",
    ),
    "a parameter that the method has not": (
        "scenarios: [tiny_room]\nentries: [{name: a, start: {python: dung_beetle}, parameters: {leg: 1}}]\n",
        "entry a: agents[0].parameters.leg: expected a parameter of Dung beetle",
    ),
    "a program that attaches itself": (
        "scenarios: [tiny_room]\nentries: [{name: a, start: {attach: true, door: tcp}}]\n",
        "a program that the benchmark starts",
    ),
    "a node of ROS 2": (
        "scenarios: [tiny_room]\nentries: [{name: a, start: {ros2: {}}}]\n",
        "a program that the benchmark starts: python or command, was ros2",
    ),
    "a zenoh command": (
        "scenarios: [tiny_room]\nentries: [{name: a, start: {command: [sh]}}]\n",
        "door: stdio, tcp or unix",
    ),
    "a suite that includes itself": ("include: [suite.yaml]\n" + ONE_ENTRY, "do not include themselves"),
    "a free agent": (
        "scenarios: [tiny_room]\nset: {pace: 1, 'agents[0].mode': free}\n" + ONE_ENTRY,
        "tiny_room: agents[0].mode: expected a mode that waits for the agent, was free",
    ),
    "a scenario twice": (
        "scenarios: [tiny_room, tiny_room]\n" + ONE_ENTRY,
        "tiny_room twice (in mine). Give one of the scenarios a name.",
    ),
    "a start twice": (
        "scenarios: [{source: tiny_room, starts: [[4.5, 2.5, 0.2], [4.5, 2.5, 0.2]]}]\n" + ONE_ENTRY,
        "tiny_room/start=4.5,2.5,0.2 twice (in mine). Write each value of starts and vary once",
    ),
    "labels alone": (
        "scenarios: [tiny_room]\nvary: [labels.wind: [a, b]]\n" + ONE_ENTRY,
        "tiny_room twice (in mine). Labels alone make no case",
    ),
    "seeds beside seeds that vary": (
        "scenarios: [{source: tiny_room, seeds: [1, 2], vary: [seed: [7, 8]]}]\n" + ONE_ENTRY,
        "scenarios[0].seeds: expected one place that gives the seeds of runs and gas, was seed in vary too",
    ),
    "seeds beside a seed that is set": (
        "scenarios: [{source: tiny_room, seeds: [1, 2]}]\nset: {gas.seed: 9}\n" + ONE_ENTRY,
        "scenarios[0].seeds: expected one place that gives the seeds of runs and gas, was gas.seed in set too",
    ),
}


@pytest.mark.parametrize(("text", "expected"), WRONG.values(), ids=WRONG.keys())
def test_a_wrong_suite_is_reported_with_its_place(tmp_path: Path, text: str, expected: str) -> None:
    with pytest.raises(ScenarioError) as refused:
        planned(tmp_path, text)
    assert expected in str(refused.value)
    assert "suite.yaml" in str(refused.value)


def test_a_written_suite_stands_alone_and_plans_the_same_trials(tmp_path: Path) -> None:
    from gslcosim_bench.cases.suite_files import write_suite

    home = tmp_path / "home"
    home.mkdir()
    (home / "mine.py").write_text(
        "from gslcosim.agent_kit import Agent\nclass One(Agent):\n"
        "    def __init__(self, briefing): pass\n    def decide(self, observation): raise RuntimeError\n"
    )
    (home / "own_room.yaml").write_text((Path(_tiny_room())).read_text().replace("name: tiny_room", "name: own_room"))
    (home / "suite.yaml").write_text(
        HEAD
        + "include: [smoke]\nscenarios: [own_room.yaml]\nentries:\n  - {name: mine, start: {python: mine.py}}\n"
        + '  - {name: shell, start: {command: [python3, mine.py, "-x"], door: stdio}}\n'
    )
    loaded = load_suite(home / "suite.yaml")
    plan = build_plan(loaded)
    write_suite(loaded, tmp_path / "copy")
    home.rename(tmp_path / "gone")
    again = build_plan(load_suite(tmp_path / "copy"))
    assert [trial.id for trial in again.trials] == [trial.id for trial in plan.trials]
    assert again.suite_hash == plan.suite_hash


def test_a_written_suite_holds_scenarios_whose_places_are_drawn_and_names_those_with_files(tmp_path: Path) -> None:
    bundled = load_suite("open_2026_quick")
    suite_files.write_suite(bundled, tmp_path / "kept")
    kept = load_suite(tmp_path / "kept")
    assert not any(Path(spec.source).is_absolute() for spec in kept.suite.scenarios)
    assert all((tmp_path / "kept" / spec.source).is_file() for spec in kept.suite.scenarios)
    assert hash_recipe(kept) == hash_recipe(bundled)
    core = next(find_scenario_beside(spec.source, bundled.directory) for spec in bundled.suite.scenarios).read_text()
    (tmp_path / "here.yaml").write_text(core.replace("environment:", "environment:\n  path: my_room", 1))
    (tmp_path / "suite.yaml").write_text(HEAD + "scenarios: [here.yaml]\n" + ONE_ENTRY)
    suite_files.write_suite(load_suite(tmp_path / "suite.yaml"), tmp_path / "named")
    assert load_suite(tmp_path / "named").suite.scenarios[0].source == str(tmp_path / "here.yaml")


def test_a_damaged_suite_file_of_results_is_written_again(tmp_path: Path) -> None:
    from gslcosim_bench.cases.suite_files import write_suite

    loaded = load_suite("smoke")
    (tmp_path / "suite.yaml").write_bytes(b"\x80\x00")
    write_suite(loaded, tmp_path)
    assert load_suite(tmp_path / "suite.yaml").suite.name == "smoke"


def _tiny_room() -> str:
    from gslcosim.base.bundled import bundled_scenarios

    return str(bundled_scenarios()["tiny_room"])


def test_trials_are_others_when_a_parameter_that_cards_share_changes(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    compute = suite_files.software_hash.__wrapped__
    before = compute()
    changed = tmp_path / "information.yaml"
    changed.write_text((SHARED_PARAMETERS / changed.name).read_text(encoding="utf-8") + "# changed\n")
    monkeypatch.setattr(suite_files, "SHARED_PARAMETERS", tmp_path)
    assert compute() != before


def test_each_trial_is_in_one_shard_with_all_of_its_case_and_repetition(tmp_path: Path) -> None:
    plan = planned(
        tmp_path,
        "scenarios: [tiny_room]\nvary: [{'agents[0].vehicle.hold_s': [0.5, 1.0, 1.5]}]\nrepetitions: 4\n"
        "controls: {no_source_frac: 0.5}\nentries:\n  - {name: beetle, start: {python: dung_beetle}}\n"
        "  - {name: walk, start: {python: random_walker}}\n",
    )
    for count in (1, 2, 5, 12, 30):
        shards = [Shard(index=i, count=count).select(plan.trials) for i in range(1, count + 1)]
        assert sorted(trial.index for shard in shards for trial in shard) == list(range(len(plan.trials)))
        units = [{(trial.case, trial.repetition) for trial in shard} for shard in shards]
        assert sum(map(len, units)) == 12
        assert max(map(len, units)) - min(map(len, units)) <= 1
        assert all(shard == sorted(shard, key=lambda trial: trial.index) for shard in shards)


def test_shards_share_few_tapes(tmp_path: Path) -> None:
    plan = planned(
        tmp_path,
        "scenarios: [tiny_room]\nset: {gas.tape: true}\nvary: [{'agents[0].vehicle.hold_s': [0.5, 1.0, 1.5]}]\n"
        "repetitions: 4\n" + ONE_ENTRY,
    )
    shards = [Shard(index=i, count=4).select(plan.trials) for i in range(1, 5)]
    assert [len({trial.tape for trial in shard}) for shard in shards] == [1, 1, 1, 1]
    chosen = choose_trials(plan.trials, Selection.of(["repetition=0,1"]), Shard(index=2, count=2))
    assert {trial.repetition for trial in chosen} == {1}
    assert len(chosen) == 3


@pytest.mark.parametrize("text", ["0/2", "3/2", "1", "1/", "/2", "a/b", "-1/2", "1/2/3", "1.0/2", "1/100001"])
def test_a_shard_that_is_none_is_refused(text: str) -> None:
    with pytest.raises(UsageError, match="--shard: expected I/N"):
        Shard.parse(text)


def test_a_shard_is_read_as_it_is_written() -> None:
    assert Shard.parse("2/8") == Shard(index=2, count=8)
    assert str(Shard.parse("2/8")) == "2/8"


def test_an_entry_that_varies_stands_for_one_of_each_combination(tmp_path: Path) -> None:
    entries = (
        "entries:\n  - name: beetle\n    start: {python: dung_beetle}\n    parameters: {eps: 0.1, leg_m: 2.0}\n"
        "    parameters_in: {tiny_room: {leg_m: 3.0}}\n    vary: {leg_m: [0.4, 0.8], wall_rule: [bounce, random]}\n"
    )
    plan = planned(tmp_path, "scenarios: [tiny_room]\n" + entries)
    listed = "entries:\n" + "".join(
        f"  - {{name: beetle_leg_m_{text}_wall_rule_{rule}, start: {{python: dung_beetle}}, "
        f"parameters: {{eps: 0.1, leg_m: {leg_m}, wall_rule: {rule}}}}}\n"
        for text, leg_m in (("0_4", 0.4), ("0_8", 0.8))
        for rule in ("bounce", "random")
    )
    assert [trial.id for trial in plan.trials] == [
        trial.id for trial in planned(tmp_path, "scenarios: [tiny_room]\n" + listed).trials
    ]
    suite_files.write_suite(plan.loaded, tmp_path / "kept")
    kept = build_plan(load_suite(tmp_path / "kept"))
    assert [trial.id for trial in kept.trials] == [trial.id for trial in plan.trials]
    (group,) = group_settings(plan.entries)
    assert group["title"] == plan.entries[0].card.title
    assert group["units"] == {"leg_m": "m", "wall_rule": "1"}
    assert group["defaults"]["leg_m"] == 0.8
    assert group["values"]["beetle_leg_m_0_4_wall_rule_bounce"] == {"leg_m": 0.4, "wall_rule": "bounce"}


def test_entries_of_one_program_are_settings_where_they_differ_in_parameters_alone(tmp_path: Path) -> None:
    entries = (
        "entries:\n  - {name: a, start: {python: dung_beetle}}\n"
        "  - {name: b, start: {python: dung_beetle}, parameters: {leg_m: 0.8}}\n"
        "  - {name: c, start: {python: dung_beetle}, parameters: {leg_m: 1.6}, robots: 2}\n"
        "  - {name: d, start: {python: dung_beetle}, parameters: {leg_m: 0.5}}\n"
    )
    plan = planned(tmp_path, "scenarios: [tiny_room]\n" + entries)
    (group,) = group_settings(plan.entries)
    assert group["values"] == {"a": {"leg_m": 0.8}, "b": {"leg_m": 0.8}, "d": {"leg_m": 0.5}}
    assert group_settings(plan.entries[:3]) == []


@pytest.mark.parametrize(
    ("vary", "message"),
    [
        ("{leg_m: [0.4, 0.4]}", "vary.leg_m: expected each value once, was 0.4 twice"),
        (
            "{leg_m: []}",
            "entries[0].vary: expected a block with names as keys, of which each is a list",
        ),
        (f"{{leg_m: {list(range(1, 502))}}}", "vary: expected at most 500 combinations of values, was 501"),
        ("{leg: [1]}", r"vary.leg: expected a parameter of Du"),
        ("{eps: [0.1, 9]}", r"vary.eps: expected at most 0.5, was 9"),
    ],
)
def test_values_that_cannot_vary_are_reported(tmp_path: Path, vary: str, message: str) -> None:
    entry = f"entries:\n  - {{name: beetle, start: {{python: dung_beetle}}, vary: {vary}}}\n"
    (tmp_path / "suite.yaml").write_text(HEAD + "scenarios: [tiny_room]\n" + entry)
    with pytest.raises(ScenarioError) as error:
        load_suite(tmp_path / "suite.yaml", is_flown=True)
    assert message in str(error.value)


MANY = (
    "scenarios: [tiny_room, {source: tiny_room, name: drawn, set: {'gas.sources[0].position_m': random}}]\n"
    "vary: [{'agents[0].vehicle.hold_s': [0.5, 1.0]}]\nrepetitions: 2\ncontrols: {no_source_frac: 0.5}\n"
    "entries:\n  - {name: beetle, start: {python: dung_beetle}}\n  - {name: walk, start: {python: random_walker}}\n"
)


@pytest.mark.parametrize(
    ("only", "n_chosen"),
    [
        (["entry=walk", "scenario=drawn", "repetition=1", "control=no"], 2),
        (["case=tiny_room/*", "control=yes"], 4),
        (["entry=nobody"], 0),
    ],
)
def test_what_is_planned_for_a_selection_is_as_in_the_whole_plan(
    tmp_path: Path, only: list[str], n_chosen: int
) -> None:
    whole, selection = planned(tmp_path, MANY), Selection.of(only)
    part = build_plan(whole.loaded, wants=selection.may_take)
    chosen = choose_trials(part.trials, selection)
    assert chosen == choose_trials(whole.trials, selection)
    assert len(chosen) == n_chosen
    # The first of each case stands for it, where maps are drawn.
    assert len(part.trials) <= n_chosen + len(whole.cases) < len(whole.trials) == part.n_trials == whole.n_trials
    assert (part.suite_hash, part.cases, part.entries) == (whole.suite_hash, whole.cases, whole.entries)
    assert part.sim_s == pytest.approx(whole.sim_s)
    beginning = Selection.of([f"trial={whole.trials[-1].id}"])
    assert choose_trials(build_plan(whole.loaded, wants=beginning.may_take).trials, beginning) == [whole.trials[-1]]


def test_the_plan_of_rows_has_their_trials_or_all(tmp_path: Path) -> None:
    whole = planned(tmp_path, MANY)
    rows = [{**trial.slot._asdict(), "trial": trial.id} for trial in whole.trials]
    part = build_plan_of_rows(whole.loaded, rows[-3:])
    assert part.trials[-3:] == whole.trials[-3:]
    assert len(part.trials) < len(whole.trials)
    assert build_plan_of_rows(whole.loaded, [rows[0] | {"case": "another"}, rows[-1]]).trials[-1] == whole.trials[-1]
    assert build_plan_of_rows(whole.loaded, [rows[-1] | {"case": "another"}]).trials == whole.trials


@pytest.mark.parametrize(
    ("only", "name"),
    [("entry=bee*,walker", None), ("entry=bee*,wolker", "wolker"), ("scenario=tiny", "tiny"), ("repetition=77", None)],
)
def test_a_pattern_that_fits_no_name_of_the_plan_is_refused(tmp_path: Path, only: str, name: str | None) -> None:
    (tmp_path / "suite.yaml").write_text(
        HEAD + "scenarios: [tiny_room]\nrepetitions: 1\nentries:\n  - {name: beetle, start: {python: dung_beetle}}\n"
        "  - {name: walker, start: {python: random_walker}}\n"
    )
    slots = []
    build_plan(load_suite(tmp_path / "suite.yaml"), wants=lambda slot: bool(slots.append(slot)))
    if name is None:
        Selection.of([only]).check_patterns(slots)
        return
    with pytest.raises(UsageError, match=f"={name}: expected a pattern of (beetle, walker|tiny_room), was '{name}'"):
        Selection.of([only]).check_patterns(slots)
