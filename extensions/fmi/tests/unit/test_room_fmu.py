"""A room as an FMI unit: importers that are not ours get the samples of `gslcosim sample` from it."""

import ctypes
import json
import re
import shlex
import shutil
import subprocess
import zipfile
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
from built_messages import build_sample
from built_rooms import build_air

from gslcosim.base.errors import UsageError
from gslcosim.cli.main import main
from gslcosim.environment.model import Cell, Environment
from gslcosim.scenario import load_scenario
from gslcosim.scenario.models.gas import FilamentGasSpec
from gslcosim.scenario.models.sensors import make_sensor_spec
from gslcosim_fmi.room_fmu import check_can_be_recorded, export_room_fmu, find_platform
from gslcosim_formats.field_samplers import Instant, ScenarioFieldSampler, ViewOptions
from gslcosim_services.sensing.models import build_sensor, sensor_kind

pytestmark = pytest.mark.skipif(shutil.which("cc") is None, reason="needs a C compiler: apt-get install gcc")

GASES = ("ethanol", "methane")
SENSORS = ("tgs2600_ideal", "pid_ideal")
N_POINTS = 40
OK, DISCARD, ERROR = 0, 2, 3
# Steps of several lengths, some between two steps of the gas, and a time that is no sum of them.
TIMES_S = (0.0, 0.05, 0.1, 0.3, 0.7, 1.42, 2.95)


def build_room() -> Environment:
    """A room that starts anywhere, with a wall that hides gas and three frames of uneven wind."""
    occupancy = np.zeros((20, 12, 8), np.uint8)
    occupancy[9, 3:10, :6] = Cell.SOLID
    occupancy[19, :, :3] = Cell.OUTLET
    wind_m_s = np.random.default_rng(3).normal([0.4, 0.0, 0.0], 0.2, (3, *occupancy.shape, 3))
    return build_air(occupancy, wind_m_s, origin_m=(-1.0, 0.5, 0.1), name="two halls", period_s=0.7)


def build_scenario(**gas):
    """Two sources of two gases before the wall, in steps of half a tick."""
    sources = [
        {"position_m": (0.6, 2.0, 1.0), "filaments_per_s": 40},
        {"position_m": (0.9, 1.4, 0.8), "filaments_per_s": 20, "gas": "methane"},
    ]
    block = {"model": "filament", "sources": sources, "step_s": 0.05, "warm_up_s": 4.0, "seed": 5, **gas}
    return load_scenario("tiny_room").scenario.model_copy(update={"gas": FilamentGasSpec.model_validate(block)})


class OpenedUnit:
    """A unit, unpacked as importers do it, with its model description."""

    def __init__(self, path: Path, folder: Path) -> None:
        self.path = path
        with zipfile.ZipFile(path) as archive:
            archive.extractall(folder)
        self.description = ElementTree.parse(folder / "modelDescription.xml").getroot()
        architecture, system, suffix = find_platform()
        identifier = self.description.find("CoSimulation").get("modelIdentifier")
        self.library = folder / "binaries" / f"{architecture}-{system}" / f"{identifier}{suffix}"
        self.resources = folder / "resources"
        self.token = self.description.get("instantiationToken")
        self.references = {
            each.get("name"): int(each.get("valueReference")) for each in self.description.find("ModelVariables")
        }


@pytest.fixture(scope="module")
def importer(tmp_path_factory):
    program = tmp_path_factory.mktemp("importer") / "fmu_importer"
    source = Path(__file__).with_name("fmu_importer.c")
    build = ["cc", "-std=c99", "-Wall", "-Wextra", "-Werror", str(source), "-o", str(program), "-ldl"]
    subprocess.run(build, check=True)

    def ask(unit, times_s, points_m, *, n_outputs=7, restart=-1):
        """Return the (t, n_points, n_outputs) values that the program prints."""
        lines = [" ".join(map(repr, [t, *some.ravel().tolist()])) for t, some in zip(times_s, points_m, strict=True)]
        words = [unit.library, unit.token, unit.resources, points_m.shape[1], n_outputs, restart]
        done = subprocess.run(
            [program, *map(str, words)], input="\n".join(lines), capture_output=True, text=True, check=False
        )
        assert (done.returncode, done.stderr) == (0, "")
        return np.array(done.stdout.split(), float).reshape(len(times_s), points_m.shape[1], n_outputs)

    return ask


def export_to(folder) -> Path:
    (path,) = export_room_fmu(
        build_room(), folder, build_scenario(), n_points=N_POINTS, until_s=3.0, sensors=SENSORS
    ).files
    return path


@pytest.fixture(scope="module")
def unit(tmp_path_factory):
    folder = tmp_path_factory.mktemp("room")
    path = export_to(folder / "out")
    assert path.name == "tiny_room.fmu"
    return OpenedUnit(path, folder / "unit")


def draw_points(n_times):
    """Points in the whole room, more of them near the sources, and its corners."""
    grid, rng = build_room().grid, np.random.default_rng(1)
    points_m = rng.uniform(grid.origin_m, grid.max_m, (n_times, N_POINTS, 3))
    points_m[:, : N_POINTS // 2] = rng.normal((1.0, 1.8, 0.9), 0.4, (n_times, N_POINTS // 2, 3))
    points_m = np.clip(points_m, grid.origin_m, grid.max_m)
    points_m[:, 0], points_m[:, 1] = grid.origin_m, grid.max_m
    return points_m


@pytest.mark.parametrize(
    "gas",
    [
        {},
        pytest.param({"wall_images": True}, marks=pytest.mark.slow),
        pytest.param({"compatibility": "gaden_3"}, marks=pytest.mark.slow),
    ],
    ids=str,
)
def test_an_importer_gets_the_samples_of_gslcosim(importer, tmp_path, gas):
    room, scenario = build_room(), build_scenario(**gas)
    (path,) = export_room_fmu(room, tmp_path / "out", scenario, n_points=N_POINTS, until_s=3.0).files
    points_m = draw_points(len(TIMES_S))
    found = importer(OpenedUnit(path, tmp_path / "unit"), TIMES_S, points_m, n_outputs=5)
    n_samples = [0] * len(GASES)
    for values, time_s, some_m in zip(found, TIMES_S, points_m, strict=True):
        instant = Instant(time_s=time_s)
        wind_m_s = ScenarioFieldSampler(room, scenario).wind_m_s(some_m, instant)
        np.testing.assert_array_equal(values[:, :3], wind_m_s)
        for i, name in enumerate(GASES):
            ppm = ScenarioFieldSampler(room, scenario, gas=name).gas_ppm(some_m, instant, ViewOptions())
            n_samples[i] += np.count_nonzero(ppm)
            np.testing.assert_allclose(values[:, 3 + i], ppm, rtol=1e-12, atol=0)
    assert min(n_samples) > 10


@pytest.mark.slow
@pytest.mark.tour
def test_the_command_writes_what_gslcosim_sample_says(importer, tmp_path, capsys):
    room = tmp_path / "tiny_room.yaml"
    text = (Path(__file__).parents[4] / "scenarios" / "tiny_room.yaml").read_text()
    room.write_text(text.replace("\ngas:\n", "\ngas:\n  turbulence: {kind: none}\n"))
    words = [str(room), "--to", "fmu", "--fmu-points", "3", "--fmu-until", "2", "--out", str(tmp_path / "out")]
    assert main(["environment", "export", *words, "--json"]) == 0
    (path,) = json.loads(capsys.readouterr().out)["files"]
    points = tmp_path / "points.csv"
    points.write_text("x_m,y_m,z_m\n1.6,2.1,1.1\n2.5,2,1\n4,2.3,1\n")
    for quantity in ("wind", "gas"):
        out = str(tmp_path / f"{quantity}.csv")
        words = [str(room), "--time", "1.7", "--points", str(points), "--quantity", quantity, "--out", out]
        assert main(["environment", "sample", *words]) == 0
    wind, gas = (np.loadtxt(tmp_path / f"{name}.csv", delimiter=",", skiprows=1)[:, 3:] for name in ("wind", "gas"))
    points_m = np.loadtxt(points, delimiter=",", skiprows=1)[np.newaxis]
    found = importer(OpenedUnit(Path(path), tmp_path / "unit"), (1.7,), points_m, n_outputs=4)[0]
    np.testing.assert_allclose(found, np.hstack([wind[:, :3], gas]), rtol=1e-12, atol=0)
    assert gas.max() > 0.0


def test_sensors_read_as_those_of_gslcosim(unit, importer):
    """In each tick within a step, at the points that were set before it."""
    room, scenario = build_room(), build_scenario()
    times_s, points_m = (0.0, 0.1, 0.15, 0.55, 1.2), draw_points(5)
    found = importer(unit, times_s, points_m)
    instruments = [
        [
            build_sensor(sensor_kind(model), make_sensor_spec(model=model, name="nose"), 100_000_000, None)
            for model in SENSORS
        ]
        for _ in range(N_POINTS)
    ]
    ticks = [0, 1, 1, 5, 12]
    for i, tick in enumerate(ticks):
        for now in range(0 if i == 0 else ticks[i - 1] + 1, tick + 1):
            shown = read_instruments(instruments, room, scenario, points_m[max(0, i - 1)], 0.1 * now)
        np.testing.assert_allclose(found[i, :, 5:], shown, rtol=1e-12, atol=0)
    assert np.count_nonzero(found[-1, :, 6]) > 10


def read_instruments(instruments, room, scenario, points_m, time_s):
    """Return the (n_points, n_models) values that instruments of ours show at points."""
    ppm = [
        ScenarioFieldSampler(room, scenario, gas=gas).gas_ppm(points_m, Instant(time_s=time_s), ViewOptions())
        for gas in GASES
    ]
    samples = [build_sample(**dict(zip(GASES, some, strict=True))) for some in np.transpose(ppm).tolist()]
    return [
        [instrument.read(sample, (0.0, 0.0, 0.0)).values[0] for instrument in some]
        for some, sample in zip(instruments, samples, strict=True)
    ]


def test_a_unit_goes_on_from_a_serialised_state(unit, importer):
    """In another instance, as where nothing was interrupted."""
    points_m = draw_points(len(TIMES_S))
    whole = importer(unit, TIMES_S, points_m)
    np.testing.assert_array_equal(importer(unit, TIMES_S, points_m, restart=3), whole)


def test_a_folder_becomes_a_unit_of_wind_alone(importer, tmp_path):
    """Without an end: the wind loops."""
    room = build_room()
    export = export_room_fmu(room, tmp_path / "out", n_points=N_POINTS)
    assert export.notices == ("The unit has the wind of two halls and no gas; name a scenario for gas.",)
    unit = OpenedUnit(export.files[0], tmp_path / "unit")
    assert "stopTime" not in unit.description.find("DefaultExperiment").attrib
    times_s = (0.0, 0.7, 5000.0)
    points_m = draw_points(3)
    found = importer(unit, times_s, points_m, n_outputs=3)
    for values, time_s, some_m in zip(found, times_s, points_m, strict=True):
        np.testing.assert_array_equal(values, ScenarioFieldSampler(room).wind_m_s(some_m, Instant(time_s=time_s)))


def test_the_same_room_gives_the_same_bytes(unit, tmp_path):
    assert export_to(tmp_path / "out").read_bytes() == unit.path.read_bytes()


class CalledUnit:
    """A unit called function by function, and what it logs."""

    def __init__(self, unit: OpenedUnit, **changes) -> None:
        self.lines = []
        signature = ctypes.CFUNCTYPE(None, ctypes.c_void_p, ctypes.c_int, ctypes.c_char_p, ctypes.c_char_p)
        self._log = signature(lambda _, status, category, text: self.lines.append(text.decode()))
        self._library = ctypes.CDLL(str(unit.library))
        words = {"token": unit.token, "resources": str(unit.resources), "event_mode": False} | changes
        self._library.fmi3InstantiateCoSimulation.restype = ctypes.c_void_p
        self.instance = self._library.fmi3InstantiateCoSimulation(
            b"room", words["token"].encode(), words["resources"].encode(), False, True, words["event_mode"], False,
            None, ctypes.c_size_t(0), None, self._log, None,
        )  # fmt: skip

    def call(self, name, *arguments) -> int:
        return getattr(self._library, name)(ctypes.c_void_p(self.instance), *arguments)

    def start(self, start_s=0.0) -> "CalledUnit":
        number = ctypes.c_double
        assert self.call("fmi3EnterInitializationMode", False, number(0), number(start_s), False, number(0)) == OK
        assert self.call("fmi3ExitInitializationMode") == OK
        return self

    def step(self, time_s, step_s) -> int:
        flags, last_s = [ctypes.c_bool() for _ in range(3)], ctypes.c_double()
        times = ctypes.c_double(time_s), ctypes.c_double(step_s)
        return self.call("fmi3DoStep", *times, True, *map(ctypes.byref, flags), ctypes.byref(last_s))

    def access(self, name, reference, value=0.0) -> int:
        one = ctypes.c_size_t(1)
        return self.call(name, ctypes.byref(ctypes.c_uint32(reference)), one, ctypes.byref(ctypes.c_double(value)), one)


def test_wrong_calls_are_refused_with_a_sentence(unit):
    called = CalledUnit(unit)
    assert called.step(0.0, 0.1) == ERROR
    called.start()
    first, n = unit.references["point[1].x_m"], len(unit.references)
    cases = [
        (DISCARD, called.access("fmi3SetFloat64", first, 4.01), "point[1].x_m: expected a point in the room, -1 m to"),
        (DISCARD, called.access("fmi3SetFloat64", first, float("nan")), "-1 m to 4 m, was nan m."),
        (ERROR, called.access("fmi3SetFloat64", first + 3), "expected a value reference of an input, was 4."),
        (ERROR, called.access("fmi3GetFloat64", n), f"expected a value reference of the unit, was {n}."),
        (ERROR, called.access("fmi3GetInt32", first), "fmi3GetInt32: expected Float64, as all variables."),
        (ERROR, called.step(0.5, 0.1), "expected a step from 0 s, where the unit is, was from 0.5 s."),
        (ERROR, called.step(0.0, 0.0), "expected a step of more than 0 s, was 0 s."),
        (DISCARD, called.step(0.0, 3.1), "expected a step to at most 3 s, where the recorded gas ends, was to 3.1 s."),
        (ERROR, called.call("fmi3EnterEventMode"), "fmi3EnterEventMode: expected a call that the model description"),
    ]
    assert "fmi3DoStep: expected another call, as the unit is instantiated." in called.lines[0]
    for (expected, status, sentence), line in zip(cases, called.lines[1:], strict=True):
        assert (status, sentence in line) == (expected, True), line
    assert called.step(0.0, 3.0) == OK


def test_a_unit_that_cannot_start_says_why(unit, tmp_path):
    cut = tmp_path / "cut"
    cut.mkdir()
    (cut / "room.bin").write_bytes((unit.resources / "room.bin").read_bytes()[:-1])
    for changes, sentence in (
        ({"token": "another"}, f"instantiationToken: expected {unit.token}, was another."),
        ({"resources": str(tmp_path)}, "expected the folder with room.bin, was without it"),
        ({"resources": str(cut)}, "room.bin: expected a whole file, was too short or too long."),
        ({"event_mode": True}, "eventModeUsed: expected false"),
    ):
        called = CalledUnit(unit, **changes)
        assert (called.instance, len(called.lines)) == (None, 1)
        assert sentence in called.lines[0]


@pytest.mark.parametrize(
    ("changes", "found"),
    [
        (["gas.model=gaussian_plume"], "was gas.model: gaussian_plume."),
        ([], "was gas.turbulence: {kind: given}. Add --set gas.turbulence.kind=none, or"),
        (["gas.rotor_downwash=true"], "was gas.rotor_downwash: true."),
        (["events=[{what: source_stops, at_s: 3}]"], "was events of sources."),
        (
            ["participants=[{name: leak, start: {command: [cat]}, writes: [source_0]}]"],
            "was a source whose rate a participant sets.",
        ),
    ],
)
def test_gas_that_a_recording_cannot_stand_for_is_refused(changes, found):
    scenario = load_scenario("tiny_room", overrides=changes).scenario
    with pytest.raises(UsageError, match=r"expected gas of model filament that nothing in a run changes") as refusal:
        check_can_be_recorded(scenario)
    assert found in str(refusal.value)


@pytest.mark.parametrize(
    ("variables", "options", "sentence"),
    [
        ({"CC": "cc '"}, [], 'CC: expected the command of a C compiler, was "cc \'": No closing quotation.'),
        ({"CC": "no_such_compiler"}, [], "expected a C compiler to compile the unit with, was none named no_such"),
        (
            {"CC": "sh -c 'echo error: no such file. >&2; echo end. >&2; exit 1'"},
            [],
            "exit code 1 (error: no such file).",
        ),
        ({"CC": "false"}, [], "expected false to compile the unit, was exit code 1 (nothing said)."),
        ({}, ["--fmu-points", "0"], "--fmu-points: expected a number from 1 to 10000, was 0."),
        ({}, ["--fmu-sensors", "pid"], "--fmu-sensors: expected some of tgs2600_ideal, tgs2602_ideal, tgs2610_ideal"),
        ({}, ["--fmu-until", "0"], "expected a number of seconds greater than 0, at most 86400, was '0'"),
    ],
)
def test_wrong_exports_are_refused_with_a_sentence(monkeypatch, tmp_path, capsys, variables, options, sentence):
    for name, value in variables.items():
        monkeypatch.setenv(name, value)
    words = ["environment", "export", "tiny_room", "--set", "gas.turbulence.kind=none", "--to", "fmu"]
    words += ["--out", str(tmp_path / "out"), *options]
    assert main(words) == 2
    assert sentence in capsys.readouterr().err
    assert not list(tmp_path.rglob("*.fmu"))


@pytest.mark.slow
@pytest.mark.extras
def test_the_calls_of_the_page_work(tmp_path, monkeypatch, capsys):
    pytest.importorskip("fmpy", reason="needs fmpy: pip install gslcosim-fmi")
    monkeypatch.chdir(tmp_path)
    page = (Path(__file__).parents[4] / "docs" / "fmi.md").read_text().split("## A room as a unit")[1]
    (call,), (program,) = (re.findall(rf"```{language}\n(.*?)```", page, re.DOTALL) for language in ("sh", "python"))
    assert main(shlex.split(call)[1:]) == 0
    capsys.readouterr()
    exec(compile(program, "docs/fmi.md", "exec"), {})
    time_s, ppm = re.fullmatch(r"(\S+) s, (\S+) ppm at most\n", capsys.readouterr().out).groups()
    assert float(time_s) == 20.0
    assert float(ppm) > 1.0


@pytest.mark.extras
def test_fmpy_has_nothing_to_say_and_gets_the_same_samples(unit):
    fmpy = pytest.importorskip("fmpy", reason="needs fmpy: pip install gslcosim-fmi")
    from fmpy.validation import validate_fmu

    assert validate_fmu(str(unit.path)) == []
    ratio = "point[1].mixing_ratio_ppm.ethanol"
    result = fmpy.simulate_fmu(
        str(unit.path),
        start_values={"point[1].x_m": 0.8},
        output=["point[1].y_m", "point[1].z_m", ratio],
        stop_time=3.0,
        output_interval=1.0,
    )
    assert result["time"].tolist() == [0.0, 1.0, 2.0, 3.0]
    for time_s, y_m, z_m, ppm in result.tolist():
        sampler = ScenarioFieldSampler(build_room(), build_scenario())
        expected = sampler.gas_ppm(np.array([[0.8, y_m, z_m]]), Instant(time_s=time_s), ViewOptions())[0]
        assert expected > 0.0
        assert ppm == pytest.approx(expected, rel=1e-12, abs=0)
