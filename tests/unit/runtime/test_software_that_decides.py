"""The packages that decide a result are listed once, and all that tell of them tell of all."""

import re
import tomllib
from pathlib import Path

from gslcosim.base.code_identity import COMPUTING_PACKAGES
from gslcosim.cli.doctor_checks import COMPILED_MODULES
from gslcosim.runtime.remote_server import SoftwareVersions
from gslcosim.runtime.replay.snapshot import CodeIdentity
from gslcosim.runtime.run_dir import MANIFEST_PACKAGES

ROOT = Path(__file__).parents[3]


def test_manifest_doctor_hosts_and_snapshots_name_them_all():
    computing = set(COMPUTING_PACKAGES)
    assert "msgspec" in computing
    assert computing <= set(MANIFEST_PACKAGES)
    assert computing <= set(COMPILED_MODULES)
    assert computing <= set(SoftwareVersions.here().packages)
    assert computing <= {each.split()[0] for each in CodeIdentity.read_own().packages.split(", ")}


def test_each_is_required_by_the_package():
    required = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["dependencies"]
    names = {re.split(r"[<>=]", each)[0] for each in required}
    assert set(MANIFEST_PACKAGES) - {"llvmlite"} <= names, "numba brings llvmlite"
