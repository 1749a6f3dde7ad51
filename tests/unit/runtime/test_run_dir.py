"""What is installed, told by one hash, and where it is not what the lock file says."""

import importlib.metadata
import re
import tomllib
from pathlib import Path

from gslcosim.runtime.run_dir import LOCK_FILE, compare_with_lock, installed_versions, versions_hash

ROOT = Path(__file__).parents[3]


def test_versions_are_those_of_the_packages_themselves():
    versions = installed_versions()
    for name in ("numpy", "numba", "msgspec", "eclipse-zenoh", "pyyaml"):
        assert versions[name] == importlib.metadata.version(name)


def test_the_first_on_the_path_counts(tmp_path, monkeypatch):
    for folder, version in (("first", "2.0"), ("second", "1.0")):
        (tmp_path / folder / f"My_Package-{version}.dist-info").mkdir(parents=True)
    (tmp_path / "first" / "my_package").mkdir()
    monkeypatch.setattr("sys.path", [str(tmp_path / "first"), str(tmp_path / "none"), str(tmp_path / "second")])
    assert installed_versions() == {"my-package": "2.0"}


def test_the_hash_is_of_names_and_versions_in_any_order():
    one, other = {"a": "1", "b": "2"}, {"b": "2", "a": "1"}
    assert versions_hash(one) == versions_hash(other)
    assert versions_hash(one) != versions_hash({"a": "1", "b": "2.1"})


def test_versions_that_the_lock_does_not_name_are_reported(tmp_path):
    lock = tmp_path / "requirements.lock"
    lock.write_text("a==1.0\nb-c==2 ; python_version < '3.12'\nb-c==3 ; python_version >= '3.12'\nabsent==1\n")
    assert compare_with_lock({"a": "1.0", "b-c": "3", "own": "9"}, lock)["differing"] == []
    assert compare_with_lock({"a": "1.1", "b-c": "4"}, lock)["differing"] == ["a", "b-c"]


def test_a_new_environments_own_installers_do_not_differ_from_the_lock(tmp_path):
    lock = tmp_path / "requirements.lock"
    lock.write_text("setuptools==84.2.1\n")
    assert compare_with_lock({"setuptools": "65.5.0"}, lock)["differing"] == []


def test_without_a_lock_nothing_is_reported(tmp_path):
    assert compare_with_lock({"a": "1"}, tmp_path / "none") is None


def test_the_lock_names_every_declared_package_and_no_registry():
    text, project = LOCK_FILE.read_text(), tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    extras = project["optional-dependencies"]
    # These have environments of their own.
    others = [entry for name in ("peers", "robot-peers", "olfactory") for entry in extras.pop(name)]
    assert others
    declared = [*project["dependencies"], *(entry for extra in extras.values() for entry in extra)]
    names = {re.match(r"[A-Za-z0-9._-]+", entry)[0].lower() for entry in declared} - {"gslcosim"}
    assert names <= set(re.findall(r"^([a-z0-9-]+)==", text, re.MULTILINE))
    assert not re.search(r"https?:|--index|@ ", text)
