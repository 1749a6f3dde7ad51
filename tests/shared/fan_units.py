"""Units of FMI for tests: a fan in C, compiled for FMI 2 or 3, whose description and archive a test may change."""

import inspect
import re
import shutil
import subprocess
import tempfile
import zipfile
from functools import cache
from pathlib import Path

import pytest

SOURCE = Path(__file__).parent / "fan_fmu.c"
VARIABLES = {
    3: """
    <Float64 name="time" valueReference="0" causality="independent"/>
    <Float64 name="gas_ppm" valueReference="1" causality="input" start="0" unit="ppm"/>
    <Float64 name="above_ppm" valueReference="2" causality="parameter" variability="fixed" start="1"/>
    <Float64 name="share" valueReference="3" causality="output"/>
    <Int32 name="n_steps" valueReference="4" causality="output"/>
    <Boolean name="is_in_gas" valueReference="5" causality="output"/>
    <Float64 name="speed" valueReference="6" causality="input" start="0" unit="km/h"/>
    <String name="words" valueReference="7" causality="output"><Start value=""/></String>""",
    2: """
    <ScalarVariable name="gas_ppm" valueReference="1" causality="input"><Real start="0" unit="ppm"/></ScalarVariable>
    <ScalarVariable name="above_ppm" valueReference="2" causality="parameter" variability="fixed"
      ><Real start="1"/></ScalarVariable>
    <ScalarVariable name="share" valueReference="3" causality="output"><Real/></ScalarVariable>
    <ScalarVariable name="n_steps" valueReference="4" causality="output" variability="discrete"
      ><Integer/></ScalarVariable>
    <ScalarVariable name="is_in_gas" valueReference="5" causality="output" variability="discrete"
      ><Boolean/></ScalarVariable>""",
}
DESCRIPTIONS = {
    3: """<?xml version="1.0" encoding="UTF-8"?>
<fmiModelDescription fmiVersion="3.0" modelName="Fan" instantiationToken="fan-1">
  <CoSimulation modelIdentifier="fan" canHandleVariableCommunicationStepSize="true" canGetAndSetFMUState="true"
    canSerializeFMUState="true"/>
  <UnitDefinitions><Unit name="ppm"/><Unit name="km/h"/></UnitDefinitions>
  <ModelVariables>{variables}
  </ModelVariables>
  <ModelStructure><Output valueReference="3"/><Output valueReference="4"/><Output valueReference="5"/>
    <Output valueReference="7"/></ModelStructure>
</fmiModelDescription>
""",
    2: """<?xml version="1.0" encoding="UTF-8"?>
<fmiModelDescription fmiVersion="2.0" modelName="Fan" guid="fan-1">
  <CoSimulation modelIdentifier="fan" canHandleVariableCommunicationStepSize="true" canGetAndSetFMUstate="true"
    canSerializeFMUstate="true"/>
  <UnitDefinitions><Unit name="ppm"/></UnitDefinitions>
  <ModelVariables>{variables}
  </ModelVariables>
  <ModelStructure><Outputs><Unknown index="3"/><Unknown index="4"/><Unknown index="5"/></Outputs></ModelStructure>
</fmiModelDescription>
""",
}


def build_fan(folder, version=3, changes=(), *, name="fan.fmu", more=(), binary=None):
    """Return the archive of a fan.

    Args:
        folder: Where it is written.
        version: That of FMI.
        changes: Texts of its description, and what takes their places.
        name: Of the archive.
        more: Names and contents of further files in it.
        binary: Its binary; absent: the right one.
    """
    fmpy = pytest.importorskip("fmpy", reason="needs pip install gslcosim-fmi")
    description = DESCRIPTIONS[version].format(variables=VARIABLES[version])
    for old, new in changes:
        assert old in description
        description = description.replace(old, new)
    platform = fmpy.platform if version == 2 else fmpy.platform_tuple
    unit = folder / name
    with zipfile.ZipFile(unit, "w") as archive:
        archive.writestr("modelDescription.xml", description)
        archive.writestr(f"binaries/{platform}/fan.so", _compile(version) if binary is None else binary)
        for path, text in more:
            archive.writestr(path, text)
    return unit


@cache
def _compile(version):
    from fmpy import fmi2, fmi3

    if shutil.which("cc") is None:
        pytest.skip("needs a C compiler: apt-get install gcc")
    type_ = fmi2.FMU2Slave if version == 2 else fmi3.FMU3Slave
    # A unit exports all functions of FMI; those that nobody calls are empty.
    written = {*re.findall(r"fmi[23]\w+", SOURCE.read_text())}
    names = [name for name, _ in inspect.getmembers(type_) if re.match(r"fmi[23][A-Z]", name) and name not in written]
    headers = Path(inspect.getfile(fmi2)).parent / "c-code"
    with tempfile.TemporaryDirectory() as folder:
        place = Path(folder)
        (place / "stubs.c").write_text("".join(f"int {name}() {{ return 0; }}\n" for name in names))
        command = ["cc", "-O1", "-w", "-shared", "-fPIC", f"-DFMI={version}", f"-I{headers}"]
        subprocess.run([*command, "-o", "fan.so", str(SOURCE), "stubs.c", "-lm"], cwd=place, check=True)
        return (place / "fan.so").read_bytes()
