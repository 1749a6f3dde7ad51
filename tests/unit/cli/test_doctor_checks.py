"""The doctor's checks: each is made to fire, and names a remedy."""

import json
import subprocess
import sys
from types import SimpleNamespace

import pytest

from gslcosim.cli import doctor_checks
from gslcosim.cli.doctor_checks import CheckResult
from gslcosim.cli.main import main


def only(findings):
    (finding,) = findings
    return finding


def test_what_an_extra_or_another_system_needs_is_not_looked_for():
    unmet = ['never-1; extra == "plot"', 'never-2; sys_platform == "win32"', 'numpy>=1; python_version > "3"']
    assert only(doctor_checks.check_packages(unmet)).name == "numpy"


def test_an_old_python_prevents_flying(monkeypatch):
    assert only(doctor_checks.check_python()).level == "OK"
    monkeypatch.setattr(sys, "version_info", (3, 10, 4, "final", 0))
    finding = only(doctor_checks.check_python())
    assert finding.level == "FAIL"
    assert finding.text.startswith("3.10.4 at ")
    assert finding.remedy == "Install Python 3.11 or newer."


def test_a_missing_or_unfit_package_has_an_install_command():
    missing, unfit = doctor_checks.check_packages(["no-such-package>=1", "numpy>=99"])
    assert (missing.level, missing.text) == ("FAIL", "missing, needs >=1")
    assert missing.remedy == f'Run: {sys.executable} -m pip install "no-such-package>=1"'
    assert unfit.level == "WARN"
    assert unfit.text.endswith(", needs >=99")


def test_an_extension_without_a_package_that_it_requires_is_named(monkeypatch):
    assert {finding.level for finding in doctor_checks.check_extensions()} <= {"OK"}
    extensions = (SimpleNamespace(distribution="gslcosim"), SimpleNamespace(distribution="gslcosim-odd"))
    monkeypatch.setattr(doctor_checks, "list_registrations", lambda: extensions)
    monkeypatch.setattr(doctor_checks.importlib.metadata, "requires", lambda _: ["numpy>=1", "no-such-package>=1"])
    finding = only(doctor_checks.check_extensions())
    assert (finding.name, finding.level) == ("gslcosim-odd", "WARN")
    assert finding.text == "no-such-package: missing, needs >=1"
    assert finding.remedy == f'Run: {sys.executable} -m pip install "no-such-package>=1"'


def test_a_package_that_cannot_be_loaded_prevents_flying(monkeypatch):
    monkeypatch.setattr(doctor_checks, "COMPILED_MODULES", ("json", "no_such_module"))
    finding = only(doctor_checks.check_imports())
    assert (finding.level, finding.text) == ("FAIL", "ModuleNotFoundError: No module named 'no_such_module'")
    monkeypatch.setattr(doctor_checks, "COMPILED_MODULES", ("json",))
    assert only(doctor_checks.check_imports()).level == "OK"


def test_one_core_is_a_limit(monkeypatch):
    monkeypatch.setattr(doctor_checks.os, "sched_getaffinity", lambda _: {0}, raising=False)
    finding = only(doctor_checks.check_cores())
    assert finding.level == "WARN"
    assert "--in-process" in finding.remedy


@pytest.mark.parametrize(("free_gb", "level"), [(8.0, "OK"), (1.0, "WARN"), (0.1, "FAIL")])
def test_little_memory_is_a_limit_and_none_prevents_flying(monkeypatch, free_gb, level):
    monkeypatch.setattr(doctor_checks, "free_memory_gb", lambda: free_gb)
    assert only(doctor_checks.check_memory()).level == level


@pytest.mark.parametrize(("free_gb", "level"), [(8.0, "OK"), (1.0, "WARN"), (0.1, "FAIL")])
def test_a_full_disk_is_reported(monkeypatch, tmp_path, free_gb, level):
    monkeypatch.setenv("GSLCOSIM_CACHE", str(tmp_path / "cache"))
    monkeypatch.setattr(doctor_checks.shutil, "disk_usage", lambda _: SimpleNamespace(free=free_gb * 1e9))
    cache, disk = doctor_checks.check_cache()
    assert (cache.level, disk.level) == ("OK", level)


def test_a_cache_that_cannot_be_written_prevents_flying(monkeypatch, tmp_path):
    (tmp_path / "file").touch()
    monkeypatch.setenv("GSLCOSIM_CACHE", str(tmp_path / "file"))
    finding = only(doctor_checks.check_cache())
    assert finding.level == "FAIL"
    assert finding.remedy == "Set GSLCOSIM_CACHE to a folder that can be written and has room."


def test_zenoh_answers_through_a_router():
    finding = only(doctor_checks.check_zenoh())
    assert finding.level == "OK"
    assert finding.text.endswith("ms through a router")


def test_a_zenoh_that_does_not_answer_prevents_flying(monkeypatch):
    def never():
        raise TimeoutError("expected an answer within 5 s, none came")

    monkeypatch.setattr(doctor_checks, "zenoh_round_trip_s", never)
    finding = only(doctor_checks.check_zenoh())
    assert (finding.level, finding.text) == ("FAIL", "expected an answer within 5 s, none came")
    assert "--in-process" in finding.remedy


def probe_saying(monkeypatch, stdout, *, error=None):
    def run(call, **_):
        if error:
            raise error
        return SimpleNamespace(stdout=stdout, returncode=0)

    monkeypatch.setattr(doctor_checks.subprocess, "run", run)


def test_drawing_is_reported_with_the_devices(monkeypatch):
    found = {"vulkan": {"is_there": True, "text": ["llvmpipe"]}, "egl": {"is_there": True, "text": "1.5"}}
    probe_saying(monkeypatch, json.dumps(found))
    assert [(f.level, f.text) for f in doctor_checks.check_rendering()] == [("OK", "llvmpipe"), ("OK", "1.5")]


@pytest.mark.parametrize("error", [None, subprocess.CalledProcessError(-11, "probe")])
def test_missing_or_crashing_drivers_are_a_limit_with_a_remedy(monkeypatch, error):
    found = {name: {"is_there": False, "text": "no driver"} for name in ("vulkan", "egl")}
    probe_saying(monkeypatch, json.dumps(found), error=error)
    vulkan, egl = doctor_checks.check_rendering()
    assert vulkan.level == egl.level == "WARN"
    assert "mesa-vulkan-drivers" in vulkan.remedy


def test_the_probe_shows_both_ways_of_drawing():
    call = [sys.executable, "-m", "gslcosim.cli.rendering_probe"]
    found = json.loads(subprocess.run(call, capture_output=True, text=True, check=True).stdout)
    assert set(found) == {"vulkan", "egl"}
    assert all(set(each) == {"is_there", "text"} for each in found.values())


def test_a_check_that_fails_itself_does_not_end_the_others(monkeypatch):
    def broken():
        raise RuntimeError("broken")

    checks = {"first": broken, "second": lambda: iter([CheckResult(name="second", level="OK", text="fine")])}
    monkeypatch.setattr(doctor_checks, "CHECKS", checks)
    assert [(f.name, f.level) for f in doctor_checks.run_checks()] == [("first", "FAIL"), ("second", "OK")]


@pytest.fixture
def findings(monkeypatch):
    """The doctor's findings, to be filled by the test."""
    found = []
    monkeypatch.setattr(doctor_checks, "run_checks", lambda: iter(found))
    return found


def test_the_doctor_writes_a_line_for_each_finding(findings, capsys):
    findings += [
        CheckResult(name="Python", level="OK", text="3.11.7"),
        CheckResult(name="CPU cores", level="WARN", text="1", remedy="Use --in-process."),
    ]
    assert main(["doctor"]) == 0
    assert capsys.readouterr().out.splitlines() == [
        "OK    Python             3.11.7.",
        "WARN  CPU cores          1. Use --in-process.",
    ]


def test_the_doctor_returns_3_when_this_machine_cannot_run(findings, capsys):
    findings.append(CheckResult(name="numpy", level="FAIL", text="missing", remedy="Install it."))
    assert main(["doctor", "--json"]) == 3
    printed = json.loads(capsys.readouterr().out)
    assert printed == {
        "able": False,
        "findings": [{"name": "numpy", "level": "FAIL", "text": "missing", "remedy": "Install it."}],
    }
