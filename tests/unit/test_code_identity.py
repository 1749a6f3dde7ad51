import pytest

from gslcosim.base import code_identity
from gslcosim.base.code_identity import hash_code, list_package_files

CODE = 'X = 1\n\n\ndef double(x):\n    """Return it twice."""\n    return 2 * x\n'


@pytest.fixture
def package(tmp_path, monkeypatch):
    monkeypatch.setattr(code_identity, "get_code_roots", lambda: {"package": tmp_path / "package"})
    monkeypatch.setenv("GSLCOSIM_CACHE", str(tmp_path / "cache"))
    (tmp_path / "package").mkdir()
    return tmp_path / "package"


def hash_of(package, text):
    (package / "module.py").write_text(text)
    return hash_code([package / "module.py"])


def test_comments_docstrings_and_layout_do_not_count(package):
    first = hash_of(package, CODE)
    assert hash_of(package, f'"""A module."""\n# why\n{CODE}') == first
    assert hash_of(package, CODE.replace('"""Return it twice."""', '"""Say more."""')) == first
    assert hash_of(package, CODE.replace("\n\n\n", "\n\n")) == first


def test_code_counts(package):
    first = hash_of(package, CODE)
    assert hash_of(package, CODE.replace("2 * x", "3 * x")) != first
    assert hash_of(package, CODE.replace("X = 1", "X = '1'")) != first


def test_the_name_and_the_order_of_modules_count(package):
    paths = [package / "a.py", package / "b.py"]
    for path in paths:
        path.write_text(CODE)
    assert hash_code(paths) != hash_code(paths[::-1])
    assert hash_code(paths[:1]) != hash_code(paths[1:])


def test_it_does_not_need_a_cache(package, monkeypatch, tmp_path):
    first = hash_of(package, CODE)
    (tmp_path / "file").write_text("")
    monkeypatch.setenv("GSLCOSIM_CACHE", str(tmp_path / "file"))
    assert hash_code([package / "module.py"]) == first


def test_folders_stand_for_their_modules():
    whole, flat = list_package_files("gslcosim/environment"), list_package_files("gslcosim/environment/*")
    assert set(flat) < set(whole)
    assert {path.parent.name for path in flat} == {"environment"}
    assert list_package_files("gslcosim/base/rng.py")[0].is_file()
