"""What becomes of OpenFOAM's tools: progress, failures with the end of the log, nothing left running.

The tools are stand-ins: shell scripts of the same name.
"""

import os

import numpy as np
import pytest

from gslcosim.base.errors import FlowError
from gslcosim.flow import Inlet, Outlet
from gslcosim_formats.openfoam import Installation, run_case, write_case

PATCHES = (
    Inlet(min_m=(0, 0, 0), max_m=(0, 2, 2), velocity_m_s=(1, 0, 0)),
    Outlet(min_m=(3, 0, 0), max_m=(3, 2, 2)),
)


@pytest.fixture
def case(tmp_path):
    return write_case(np.ones((3, 2, 2), bool), 1.0, PATCHES, tmp_path / "case", end_time_s=2.0, n_ranks=1)


@pytest.fixture
def openfoam(tmp_path):
    def make(script):
        tool = tmp_path / "bin" / "pimpleFoam"
        tool.parent.mkdir()
        tool.write_text(f"#!/bin/sh\n{script}\n")
        tool.chmod(0o755)
        return Installation(project_dir=tmp_path, environment={"PATH": f"{tool.parent}:{os.environ['PATH']}"})

    return make


def test_the_time_of_each_step_is_reported(case, openfoam):
    times_s = []
    run_case(
        case, openfoam('echo "Time = 0.5"; echo "ExecutionTime = 3 s"; echo "Time = 1e+00"'), on_time=times_s.append
    )
    assert times_s == [0.5, 1.0]
    assert "ExecutionTime" in (case.folder / "log.pimpleFoam").read_text()


def test_a_failure_has_the_end_of_the_log_and_its_path(case, openfoam):
    broken = openfoam('seq 1 100; echo "Floating point exception"; exit 136')
    with pytest.raises(FlowError) as caught:
        run_case(case, broken, on_time=lambda _: None)
    lines = str(caught.value).splitlines()
    assert lines[0].startswith("pimpleFoam failed with exit status 136")
    assert lines[-2:] == ["Floating point exception", f"Log: {case.folder / 'log.pimpleFoam'}"]
    assert "87" in lines
    assert "86" not in lines


def test_a_solve_that_is_interrupted_leaves_no_process_behind(case, openfoam, tmp_path):
    def interrupt(_time_s):
        raise KeyboardInterrupt

    endless = openfoam(f'echo $$ > {tmp_path}/pid; echo "Time = 1"; exec sleep 600')
    with pytest.raises(KeyboardInterrupt):
        run_case(case, endless, on_time=interrupt)
    with pytest.raises(ProcessLookupError):
        os.kill(int((tmp_path / "pid").read_text()), 0)
