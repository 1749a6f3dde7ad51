"""Units of FMI behind their core, without a run around them: steps, states, faults, and what `validate` refuses."""

import json
import math
import re
import shutil
import zipfile
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import msgpack
import numpy as np
import pytest
import yaml
from built_messages import build_body, build_poses, build_sample
from built_runs import build_setup
from fan_units import build_fan

from gslcosim.base.errors import SimulationFault
from gslcosim.contract.environment_messages import ProbeSample, ProbeSamples
from gslcosim.contract.messages import FieldSamples, GasAmount
from gslcosim.contract.participant import Episode
from gslcosim.environment.generation.cache import prepare_environment
from gslcosim.environment.store import load_environment
from gslcosim.runtime.run_dir import RunDir
from gslcosim.runtime.services import build_dataflow
from gslcosim.scenario import load_scenario
from gslcosim.scenario.problems import InvalidScenarioError
from gslcosim_fmi.checks import find_fmu_problems, find_fmu_warnings
from gslcosim_fmi.core import FmuCore
from gslcosim_fmi.room_fmu import export_room_fmu
from gslcosim_formats.field_samplers import Instant, ScenarioFieldSampler, ViewOptions

pytestmark = pytest.mark.extras

GAS = "samples[sensor=nose].gases[gas=ethanol].mixing_ratio_ppm"
PPM = [0.0, 2.0, 3.0, 0.1, 0.0, 4.0, 4.0, 0.0]
# Time for a busy machine to come as far as the function that hangs.
HANG_S = 12.0
FMI_PAGE = Path(__file__).parents[4] / "docs" / "fmi.md"


def block(unit, *, inputs=None, outputs=None, **more):
    return {
        "name": "fan",
        "start": {"fmu": str(unit)},
        "reads": [{"port": "truth/samples", "inputs": {"gas_ppm": GAS} if inputs is None else inputs}],
        "writes": ["ventilation", "state"],
        "outputs": outputs
        or {"ventilation": {"share": "share"}, "state": {"n_steps": "n_steps", "is_in_gas": "is_in_gas"}},
        "parameters": {"above_ppm": 0.5},
        "sandbox": "none",
        "answer_within_s": 25.0,
        **more,
    }


def load(own, *words):
    return load_scenario("tiny_room", overrides=[f"participants=[{json.dumps(own)}]", *words])


@pytest.fixture
def core_of(tmp_path):
    """Return the core of a unit, which is closed in the end."""
    cores = []

    def build(own, *words):
        loaded = load(own, *words)
        run_dir = RunDir.create(tmp_path, name=f"run_{len(cores)}", seed=1)
        setup = build_setup(loaded, tmp_path, run_dir=run_dir, directory=tmp_path)
        cores.append(FmuCore(loaded.scenario.participants[0], setup, build_dataflow(loaded.scenario).message_types))
        return cores[-1]

    yield build
    for core in cores:
        core.close()


def samples(tick):
    sample = build_sample(wind_m_s=(0.5, 0.0, 0.0), ethanol=PPM[tick])
    return {"truth/samples": FieldSamples(tick=tick, samples=(sample,))}


def step(core, ticks):
    return [core.step(tick, samples(tick)) for tick in ticks]


def simulate(unit, *, inputs, outputs, start_values=None):
    """Return the outputs at the ticks of fmpy's own simulation of a unit."""
    import fmpy

    times_s = np.arange(len(PPM)) / 10
    signals = np.array(list(zip(times_s, PPM, strict=True)), dtype=[("time", float), (inputs, float)])
    # An input has over each step the value at its beginning, as here.
    found = fmpy.simulate_fmu(
        str(unit),
        fmi_type="CoSimulation",
        start_time=0.0,
        stop_time=times_s[-1],
        output_interval=0.1,
        input=signals,
        output=outputs,
        start_values=start_values or {},
    )
    return np.array([[float(row[name]) for name in outputs] for row in found])


@pytest.mark.parametrize("version", [2, 3])
def test_a_unit_steps_as_in_fmpy_and_goes_on_from_its_state(tmp_path, core_of, version):
    unit = build_fan(tmp_path, version)
    core = core_of(block(unit), "snapshots.every_s=1")
    core.reset(Episode(seed=1))
    first = step(core, range(4))
    state = core.state()
    rest = step(core, range(4, len(PPM)))
    found = [[box["truth/wind"].share, box["participant/fan/state"].values["n_steps"]] for box in first + rest]
    expected = simulate(unit, inputs="gas_ppm", outputs=["share", "n_steps"], start_values={"above_ppm": 0.5})
    # Its times are added up, so that the last bits of its steps differ.
    np.testing.assert_allclose(np.array(found, dtype=float), expected, rtol=1e-12)
    # A new start of it has seen nothing, and then all.
    core.reset(Episode(seed=1))
    core.restore(state)
    assert step(core, range(4, len(PPM))) == rest


def test_a_unit_reads_the_gas_at_a_probe_as_on_the_page(tmp_path, core_of):
    (line,) = re.findall(r"^- (\{port: truth/probes, .*\})$", FMI_PAGE.read_text(encoding="utf-8"), re.MULTILINE)
    own = block(build_fan(tmp_path), reads=[yaml.safe_load(line)])
    probes = "probes=[{name: other, position_m: [2, 2, 1]}, {name: return_air, position_m: [3, 2, 1]}]"
    loaded = load(own, probes)
    assert [*find_fmu_problems(loaded.scenario, loaded.directory)] == []
    without = load(own, probes.replace("return_air", "supply_air"))
    (problem,) = find_fmu_problems(without.scenario, without.directory)
    assert "expected one of this scenario's (other, supply_air) for probe, was 'return_air'." in str(problem)
    core = core_of(own, probes)
    core.reset(Episode(seed=1))
    found = []
    for tick, ppm in enumerate(PPM):
        samples = tuple(
            ProbeSample(
                probe=name,
                gases=(GasAmount(gas="ethanol", mixing_ratio_ppm=value),),
                wind_world_m_s=(0.5, 0.0, 0.0),
            )
            for name, value in (("other", 9.0), ("return_air", ppm))
        )
        box = core.step(tick, {"truth/probes": ProbeSamples(tick=tick, samples=samples)})
        found.append(box["participant/fan/state"].values["is_in_gas"])
    # It steps to a tick with the inputs of the tick before.
    assert found[1:] == [ppm > 0.5 for ppm in PPM[:-1]]


@pytest.mark.skipif(shutil.which("cc") is None, reason="needs a C compiler: apt-get install gcc")
def test_a_room_that_left_as_a_unit_takes_part_with_its_own_samples(tmp_path, core_of):
    loaded = load_scenario("tiny_room", overrides=["gas.turbulence.kind=none"])
    environment = load_environment(prepare_environment(loaded.scenario, scenario_dir=loaded.directory))
    sensors = ("tgs2600_ideal",)
    (unit,) = export_room_fmu(environment, tmp_path / "out", loaded.scenario, until_s=1.0, sensors=sensors).files
    inputs = {f"point[1].{axis}_m": f"bodies[agent=beetle].position_world_m[{i}]" for i, axis in enumerate("xyz")}
    outputs = {"ppm": "point[1].mixing_ratio_ppm.ethanol", "ohm": "point[1].tgs2600_ideal.resistance_ohm"}
    room = block(unit, reads=[{"port": "truth/bodies", "inputs": inputs}], writes=["state"], parameters={})
    core = core_of({**room, "outputs": {"state": outputs}}, "snapshots.every_s=1")
    positions_m = [(1.6 + 0.02 * tick, 2.1, 1.1) for tick in range(8)]

    def fly(ticks):
        boxes = [core.step(tick, {"truth/bodies": pose_at(tick, positions_m[tick])}) for tick in ticks]
        return [box["participant/fan/state"].values for box in boxes]

    core.reset(Episode(seed=1))
    first = fly(range(4))
    state = core.state()
    rest = fly(range(4, 8))
    # It steps to a tick with the inputs of the tick before.
    for tick, values in enumerate(first + rest):
        point_m, instant = np.array([positions_m[max(0, tick - 1)]]), Instant(frame=tick)
        expected = ScenarioFieldSampler(environment, loaded.scenario).gas_ppm(point_m, instant, ViewOptions())[0]
        assert expected > 0.0
        assert values["ppm"] == pytest.approx(expected, rel=1e-12, abs=0)
    assert rest[-1]["ohm"] < first[0]["ohm"] == 50000.0
    core.reset(Episode(seed=1))
    core.restore(state)
    assert fly(range(4, 8)) == rest


def pose_at(tick, position_m):
    return build_poses(tick, build_body("beetle", position_m))


def test_a_unit_that_cannot_save_its_state_steps_through_its_past(tmp_path, core_of):
    unit = build_fan(tmp_path, 3, [('canSerializeFMUState="true"', "")])
    core = core_of(block(unit, period_s=0.2), "snapshots.every_s=1")
    core.reset(Episode(seed=1))
    step(core, range(4))
    state = core.state()
    assert len(state["past"]) == 2
    rest = step(core, range(4, len(PPM)))
    # Between its steps the wind stays as it is.
    assert rest[1]["truth/wind"].share == rest[0]["truth/wind"].share
    core.reset(Episode(seed=1))
    core.restore(state)
    assert step(core, range(4, len(PPM))) == rest
    loaded = load(block(unit), "snapshots.every_s=1")
    (warning,) = find_fmu_warnings(loaded.scenario, loaded.directory)
    assert "expected a unit that can serialize its state, for snapshots, was Fan, which cannot" in str(warning)


def test_a_unit_with_a_fixed_step_does_several_in_a_period(tmp_path, core_of):
    fixed = [('canHandleVariableCommunicationStepSize="true"', 'fixedInternalStepSize="0.05"')]
    core = core_of(block(build_fan(tmp_path, 3, fixed)))
    core.reset(Episode(seed=1))
    assert [box["participant/fan/state"].values["n_steps"] for box in step(core, range(4))] == [0, 2, 4, 6]


THREE = (
    "load", "fmi3InstantiateCoSimulation", "fmi3SetFloat64", "fmi3EnterInitializationMode",
    "fmi3ExitInitializationMode", "fmi3GetFloat64", "fmi3GetInt32", "fmi3GetBoolean", "fmi3DoStep", "fmi3GetFMUState",
    "fmi3SerializedFMUStateSize", "fmi3SerializeFMUState", "fmi3FreeFMUState", "fmi3DeserializeFMUState",
    "fmi3SetFMUState",
)  # fmt: skip


def run_whole(core):
    """Call every function of a unit."""
    core.reset(Episode(seed=1))
    step(core, range(3))
    state = core.state()
    core.reset(Episode(seed=1))
    core.restore(state)


def told_fault(core):
    with pytest.raises(SimulationFault) as caught:
        run_whole(core)
    return str(caught.value)


@pytest.mark.parametrize("function", [*THREE, "fmi2Instantiate", "fmi2SetFMUstate"])
def test_a_crash_in_any_function_is_named_with_it(tmp_path, core_of, function):
    unit = build_fan(tmp_path, 2 if function.startswith("fmi2") else 3)
    core = core_of(block(unit, environment={"UNIT_FAULT": f"{function}:crash"}))
    where = "the loading of its binary" if function == "load" else function
    text = told_fault(core)
    assert text.startswith("expected ")
    assert f" from {where}, but its process was killed by SIGABRT." in text


def test_a_hang_in_any_function_ends_at_the_deadline_and_is_named_with_it(tmp_path, core_of):
    unit = build_fan(tmp_path)
    functions = ("load", "fmi3InstantiateCoSimulation", "fmi3DoStep", "fmi3GetFloat64", "fmi3SetFMUState")
    own = [block(unit, answer_within_s=HANG_S, environment={"UNIT_FAULT": f"{name}:hang"}) for name in functions]
    cores = [core_of(each) for each in own]
    with ThreadPoolExecutor(len(cores)) as pool:
        texts = [*pool.map(told_fault, cores)]
    for function, text in zip(functions, texts, strict=True):
        where = "the loading of its binary" if function == "load" else function
        assert f" from {where}, nothing came within {HANG_S:g} s" in text


@pytest.mark.parametrize(
    ("version", "fault", "expected"),
    [
        (
            3,
            "fmi3DoStep:error",
            "fmi3DoStep: expected status OK or Warning at 0.1 s, was Error. It logged: the fan is stuck.",
        ),
        (3, "fmi3DoStep:fatal", "fmi3DoStep: expected status OK or Warning at 0.1 s, was Fatal."),
        (3, "fmi3DoStep:discard", "fmi3DoStep: expected status OK or Warning at 0.1 s, was Discard."),
        (3, "fmi3DoStep:end", "fmi3DoStep: expected a step to 0.1 s, the unit asked to end the simulation."),
        (3, "fmi3DoStep:early", "fmi3DoStep: expected a step to 0.1 s, it returned early at 0.05 s."),
        (3, "fmi3DoStep:exit", "the outputs of tick 1 from fmi3DoStep, but its process ended with exit code 7."),
        (3, "share:nan", "outputs.ventilation: WindShare: share: input should be a finite number, was nan, at tick"),
        (3, "share:negative", "greater than or equal to 0, was -1.0, at tick 1."),
        (3, "fmi3SetFloat64:error", "fmi3SetFloat64: expected status OK or Warning, was Error."),
        (3, "fmi3InstantiateCoSimulation:error", "fmi3InstantiateCoSimulation: expected an instance, was none"),
        (2, "fmi2DoStep:discard", "fmi2DoStep: expected a step at 0.1 s, was Discard; it got to 0.05 s. It logged: "),
        (2, "fmi2DoStep:error", "was Error. It logged: the fan is stuck."),
        (2, "fmi2SetupExperiment:error", "fmi2SetupExperiment: expected status OK or Warning, was Error."),
        (2, "fmi2DoStep:segfault", "the outputs of tick 1 from fmi2DoStep, but its process was killed by SIGSEGV."),
    ],
)  # fmt: skip
def test_each_fault_is_one_sentence_with_the_status_and_the_log_of_the_unit(
    tmp_path, core_of, version, fault, expected
):
    core = core_of(block(build_fan(tmp_path, version), environment={"UNIT_FAULT": fault}))
    assert expected in told_fault(core)


def test_the_exception_of_a_unit_in_python_is_in_its_fault(tmp_path, core_of):
    builder = pytest.importorskip("pythonfmu3.builder", reason="needs pip install pythonfmu3")
    page = Path(__file__).parents[4] / "docs" / "examples" / "fmi" / "fan_controller.py"
    first = "self.time = current_time + step_size"
    script = tmp_path / page.name
    script.write_text(page.read_text().replace(first, f"{first}\n        raise ValueError('no power')"))
    builder.FmuBuilder.build_FMU(script, dest=tmp_path)
    outputs = {"ventilation": {"share": "share"}, "state": {"is_on": "is_on"}}
    text = told_fault(core_of(block(tmp_path / "FanController.fmu", outputs=outputs)))
    assert "fmi3DoStep: expected status OK or Warning at 0.1 s, was Fatal. It logged: " in text
    assert "ValueError('no power')" in text


def test_a_wrong_token_is_named_and_what_a_unit_prints_does_no_harm(tmp_path, core_of):
    wrong = build_fan(tmp_path, 3, [("fan-1", "fan-2")])
    text = told_fault(core_of(block(wrong)))
    assert "expected an instance, was none, as where the token of the binary is not that of its description" in text
    assert "It logged: the token is wrong." in text
    run_whole(core_of(block(build_fan(tmp_path), environment={"UNIT_FAULT": "fmi3DoStep:print"})))


@pytest.mark.parametrize(
    ("fault", "expected"),
    [
        ("fmi3Terminate:hang", "nothing came within 2 s"),
        ("fmi3Terminate:error", "fmi3Terminate: expected status OK or Warning at 0.3 s, was Error."),
        ("fmi3FreeInstance:crash", "from fmi3FreeInstance, but its process was killed by SIGABRT."),
    ],
)
def test_a_fault_after_the_last_step_is_noted_in_the_log(tmp_path, core_of, fault, expected):
    core = core_of(block(build_fan(tmp_path), environment={"UNIT_FAULT": fault}))
    core.reset(Episode(seed=1))
    step(core, range(3))
    core.close()
    assert expected in next(tmp_path.rglob("participant_fan.log")).read_text()


def test_binaries_that_are_none_are_named(tmp_path, core_of):
    import fmpy.logging

    text = told_fault(core_of(block(build_fan(tmp_path, binary=b"MZ of another machine"))))
    assert "expected a binary that can be loaded, could not: Failed to load shared library" in text
    broken = bytearray(build_fan(tmp_path).read_bytes())
    middle = len(broken) // 2
    broken[middle : middle + 8] = b"\xff" * 8
    (tmp_path / "broken.fmu").write_bytes(broken)
    text = told_fault(core_of(block(tmp_path / "broken.fmu")))
    assert text.startswith("expected an archive that can be unpacked, could not: Bad CRC-32 for file 'binaries/")
    (text,) = find_problems(block(tmp_path / "broken.fmu"))
    assert "start.fmu: expected an archive whose files can be unpacked, was one with a broken 'binaries/" in text
    other = next(Path(fmpy.logging.__file__).parent.rglob("*.so")).read_bytes()
    text = told_fault(core_of(block(build_fan(tmp_path, binary=other))))
    assert "expected a binary with all functions of FMI 3, was one without: " in text


def find_problems(own):
    loaded = load(own)
    return [str(problem) for problem in find_fmu_problems(loaded.scenario, loaded.directory)]


@pytest.mark.parametrize(
    ("changes", "expected"),
    [
        ({"inputs": {"gas": GAS}}, "reads[0].inputs.gas: expected an input of Fan (gas_ppm, speed), was 'gas'."),
        ({"inputs": {"share": GAS}}, "expected an input of Fan, was 'share', of causality output."),
        ({"inputs": {"gas_ppm": "samples[0].gas"}}, "expected one of agent, beam_m, gases, sensor, wind_world_m_s"),
        ({"inputs": {"gas_ppm": "samples[0]"}}, "expected a number, a truth value or a text, which needs one of"),
        ({"inputs": {"gas_ppm": GAS.replace("nose", "eye")}}, "for sensor, was 'eye'."),
        ({"inputs": {"gas_ppm": GAS.replace("ethanol", "neon")}}, "expected one of this scenario's (ethanol) for gas"),
        ({"inputs": {"gas_ppm": "samples[0].sensor"}}, "a variable that takes a text, as sensor is, was gas_ppm"),
        ({"inputs": {"gas_ppm": "time_s"}}, "expected a variable in s, as the end of time_s says, was gas_ppm in ppm."),
        ({"inputs": {"speed": "samples[0].wind_world_m_s[0]"}}, "end of wind_world_m_s says, was speed in km/h."),
        ({"parameters": {"above": 1.0}}, "parameters.above: expected a parameter of Fan (above_ppm), was 'above'."),
        ({"parameters": {"above_ppm": "high"}}, "parameters.above_ppm: expected a number, was 'high'."),
        (
            {"outputs": {"ventilation": {"share": "shares"}, "state": {"a": "words"}}},
            "ventilation.share: expected an output of Fan (share, n_steps, is_in_gas, words), was 'shares'. Did",
        ),
        (
            {"outputs": {"ventilation": {"share": "share"}, "state": {"a": "words"}}},
            "outputs.state.a: expected a number or a truth value, was words, which is String.",
        ),
    ],
)  # fmt: skip
def test_variables_that_do_not_fit_are_refused_before_the_run(tmp_path, changes, expected):
    assert expected in "\n".join(find_problems(block(build_fan(tmp_path), **changes)))


def test_steps_that_do_not_fit_are_refused_with_both_numbers(tmp_path):
    fixed = [('canHandleVariableCommunicationStepSize="true"', 'fixedInternalStepSize="0.07"')]
    assert find_problems(block(build_fan(tmp_path, 3, fixed))) == [
        "participants[0].period_s: expected a whole number of the unit's steps of 0.07 s, was 0.1 s. "
        "Set period_s: 0.7, or export the unit with another step."
    ]


@pytest.mark.parametrize(
    ("changes", "expected"),
    [
        (
            [("CoSimulation modelId", "ModelExchange modelId")],
            "expected a unit for co-simulation, was one for model",
        ),
        ([('fmiVersion="3.0"', 'fmiVersion="4.0"')], "expected a modelDescription.xml that can be read, was another"),
        ([('modelIdentifier="fan"', 'modelIdentifier="pump"')], "/pump.so, which this machine needs, was binaries for"),
        ([("</fmiModelDescription>", "")], "expected a modelDescription.xml that can be read, was another"),
        ([(' fmiVersion="3.0"', "")], "expected a modelDescription.xml with all that FMI asks for, such as fmiVersion"),
        (
            [("<CoSimulation", "<!--"), ('canSerializeFMUState="true"/>', "-->")],
            "expected a unit for co-simulation, was one without any kind.",
        ),
        *(
            (
                [('canHandleVariableCommunicationStepSize="true"', f'fixedInternalStepSize="{step_s}"')],
                f"expected a fixed step from 1e-09 to 86400 s, was {float(step_s):g} s.",
            )
            for step_s in ("INF", "NaN", "-0.1", "0")
        ),
    ],
)
def test_a_description_that_is_none_is_refused_in_one_sentence(tmp_path, changes, expected):
    (text,) = find_problems(block(build_fan(tmp_path, 3, changes)))
    assert text.startswith("participants[0].start.fmu: expected ")
    assert expected in text


def test_an_archive_that_is_none_is_refused_in_one_sentence(tmp_path):
    unit = build_fan(tmp_path)
    other = tmp_path / "other.fmu"
    other.write_bytes(unit.read_bytes()[:-100])
    (text,) = find_problems(block(other))
    assert "participants[0].start.fmu: expected an FMU, a whole zip archive, was another file: " in text
    (text,) = find_problems(block(build_fan(tmp_path, name="out.fmu", more=[("../../evil.so", "")])))
    assert "expected names of files within the archive, was '../../evil.so', which leads out of it." in text
    with zipfile.ZipFile(other, "w") as archive:
        archive.writestr("readme.txt", "")
    (text,) = find_problems(block(other))
    assert "expected a unit with a modelDescription.xml, was an archive without." in text
    with zipfile.ZipFile(unit) as source, zipfile.ZipFile(other, "w") as archive:
        archive.writestr("modelDescription.xml", source.read("modelDescription.xml"))
        archive.writestr("binaries/x86_64-windows/fan.dll", "")
    (text,) = find_problems(block(other))
    assert text.endswith("/fan.so, which this machine needs, was binaries for x86_64-windows.")


@pytest.mark.parametrize(
    ("changes", "expected"),
    [
        ({"start": {"fmu": "nothing.fmu"}}, "participants[0].start.fmu: expected an FMU, was 'nothing.fmu'."),
        ({"start": {}}, "participants[0].start: expected exactly one of command and fmu, was none."),
        ({"start": {"command": ["cat"]}}, "expected start.fmu beside variables of a unit, was reads[].inputs"),
        ({"outputs": {"state": {"a": "share"}}}, "expected variables of the unit for each of its writes (state, vent"),
        (
            {"outputs": {"ventilation": {"x": "share"}, "state": {"a": "share"}}},
            "participants[0].outputs.ventilation: expected share, and nothing else, was x.",
        ),
        (
            {"writes": ["source_0"], "outputs": {"source_0": {"rate": "share"}}},
            "participants[0].outputs.source_0: expected filaments_per_s, and nothing else, was rate.",
        ),
    ],
)
def test_a_block_that_cannot_be_is_refused(tmp_path, changes, expected):
    unit = tmp_path / "fan.fmu"
    unit.touch()
    with pytest.raises(InvalidScenarioError) as caught:
        load({**block(unit), **changes})
    assert expected in str(caught.value)


def frame(value):
    packed = value if isinstance(value, bytes) else msgpack.packb(value)
    return (len(packed).to_bytes(4, "big") + packed).hex()


# What a unit writes to the pipes of its process at a function, and what its fault says.
FRAMES = {
    "a list": ("load", frame([1, 2, 3]), "expected an instance of the unit, its answer: expected a msgpack map, was"),
    "a number": ("load", frame(7), "expected an instance of the unit, its answer: expected a msgpack map, was int"),
    "no msgpack": ("load", frame(b"\xc1\xc1"), "expected a msgpack map, was 2 bytes starting c1c1"),
    "nothing": ("load", "00000000", "expected a msgpack map, was 0 bytes"),
    "too long": ("load", "ffffffff" + "78" * 100, "expected the length of a frame in 4 bytes"),
    "deep": ("load", frame(b"\x91" * 1500 + b"\xc0"), "expected a msgpack map, was 1501 bytes"),
    "bytes for a key": ("load", frame({b"\xff": 1}), "expected an instance of the unit, its answer: expected a text"),
    "a key twice": ("load", frame(b"\x82\xa1a\x01\xa1a\x02"), "expected each key once, was 'a' 2 times"),
    "a fault that is none": ("load", frame({"fault": 5}), "fault: expected a text, was a whole number"),
    "escape sequences": ("load", frame({"fault": "\x1b[2Jx"}), r"\x1b[2Jx."),
    "two answers": ("load", frame({}) * 2, "something came before it was asked"),
    "no values": ("fmi3DoStep", frame({}), "expected the outputs of tick 1, its answer: expected the key values"),
    "one value": ("fmi3DoStep", frame({"values": [1.0]}), "expected the outputs of tick 1, 3 values, was 1"),
    "a number of values": ("fmi3DoStep", frame({"values": 3}), "values: expected a list, was a whole number"),
    "maps": ("fmi3DoStep", frame({"values": [{"a": 1}] * 3}), "values[0]: expected true or false or"),
    "times": ("fmi3DoStep", frame({"values": [msgpack.Timestamp(1)] * 3}), "values[0]: expected true or false or"),
    "bytes": ("fmi3DoStep", frame({"values": [b"\xff"] * 3}), "values[0]: expected true or false or"),
    "nones": ("fmi3DoStep", frame({"values": [None] * 3}), "values[0]: expected true or false or"),
    "texts": ("fmi3DoStep", frame({"values": ["x"] * 3}), "share: input should be a valid number, was 'x', at tick 1"),
    "NaN": ("fmi3DoStep", frame({"values": [math.nan] * 3}), "should be a finite number, was nan, at tick 1"),
    "half a frame": ("fmi3DoStep", frame({"values": [1.0] * 3})[:18] + "00" * 9, "expected the outputs of tick 1"),
    "a size below zero": ("fmi3SerializeFMUState", frame({"n_bytes": -5}), "bytes, was one of -5"),
    "an endless size": ("fmi3SerializeFMUState", frame({"n_bytes": 2**62}), f"bytes, was one of {2**62}"),
    "a word for a size": ("fmi3SerializeFMUState", frame({"n_bytes": "x"}), "n_bytes: expected a whole number"),
}  # fmt: skip


@pytest.mark.slow
@pytest.mark.parametrize("name", FRAMES)
def test_whatever_a_unit_answers_itself_is_a_fault_in_a_sentence(tmp_path, core_of, name):
    function, written, expected = FRAMES[name]
    core = core_of(block(build_fan(tmp_path), environment={"UNIT_FRAMES": f"{function}:{written}"}))
    text = told_fault(core)
    assert expected in text
    assert "\x1b" not in text
    core.close()
    (log,) = tmp_path.glob("*/logs/participant_fan.log")
    assert "Traceback" not in log.read_text()


def test_an_archive_that_unpacks_to_too_much_is_refused_before_it_is(tmp_path):
    unit = build_fan(tmp_path)
    with zipfile.ZipFile(unit, "a", zipfile.ZIP_DEFLATED) as archive, archive.open("documentation/x", "w") as member:
        for _ in range(1100):
            member.write(bytes(1 << 20))
    assert unit.stat().st_size < 4 << 20
    loaded = load(block(unit))
    (problem,) = find_fmu_problems(loaded.scenario, loaded.directory)
    assert "expected at most 1024 MB of files, was 1100 MB" in str(problem)
