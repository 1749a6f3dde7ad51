"""Numba's files are pickles: only those that a process of ours has signed are loaded."""

import os
import pickle
import shutil
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest
from kernel_archives import pack

from gslcosim.base import kernel_archives
from gslcosim.base.kernel_cache import (
    EXTENSIONS_VARIABLE,
    NUMBA_VARIABLE,
    OWNER_VARIABLE,
    PACKAGE_DIR,
    choose_processor_level,
    get_key_path,
    use_kernel_cache,
)
from gslcosim.environment.grid_kernels import to_next_border

PROGRAM = """
import gslcosim, numba

@numba.njit(cache=True)
def twice(x):
    return 2 * x

@numba.njit(cache=True)
def once(x):
    return x

assert (twice(1), once(1)) == (2, 1)
print(sum(sum(d.stats.cache_hits.values()) for d in (twice, once)))
"""


class Planted:
    """A pickle that makes a file when it is loaded."""

    def __init__(self, mark):
        self.mark = mark

    def __reduce__(self):
        return os.mkdir, (str(self.mark),)


@pytest.fixture
def cached(tmp_path):
    """Run the program with a cache of its own, and return how many kernels it has loaded."""
    (tmp_path / "program.py").write_text(PROGRAM)
    variables = {k: v for k, v in os.environ.items() if not k.startswith(("NUMBA", "GSLCOSIM"))}

    def run(prefix=(), **settings):
        return int(
            subprocess.run(
                [*prefix, sys.executable, str(tmp_path / "program.py")],
                env=variables | {"GSLCOSIM_CACHE": str(tmp_path / "cache")} | settings,
                capture_output=True,
                text=True,
                check=True,
            ).stdout
        )

    assert run() == 0
    return run


def files_in(folder, ending):
    """Return the files of numba below a folder, by the function's name."""
    return {path.name.partition("-")[0]: path for path in folder.rglob(f"*.{ending}")}


def test_what_one_process_has_compiled_the_next_one_loads(cached):
    assert cached() == 2


def test_of_two_processes_one_compiles_a_kernel(cached, tmp_path):
    shutil.rmtree(tmp_path / "cache")
    with ThreadPoolExecutor(2) as pool:
        assert sum(pool.map(lambda _: cached(), range(2))) == 2


def test_a_failure_to_compile_leaves_no_lock(tmp_path):
    program = """
import contextlib, fcntl, os, subprocess, sys
import gslcosim, numba

@numba.njit(cache=True)
def fails(x):
    return x.nothing

with contextlib.suppress(numba.TypingError):
    fails(1)
taken = "import fcntl, sys; fcntl.lockf(open(sys.argv[1], 'r+'), fcntl.LOCK_EX | fcntl.LOCK_NB)"
subprocess.run([sys.executable, "-c", taken, os.path.join(os.environ["NUMBA_CACHE_DIR"], "compiling.lock")], check=True)
"""
    (tmp_path / "program.py").write_text(program)
    variables = {k: v for k, v in os.environ.items() if not k.startswith(("NUMBA", "GSLCOSIM"))}
    variables["GSLCOSIM_CACHE"] = str(tmp_path / "cache")
    subprocess.run([sys.executable, str(tmp_path / "program.py")], env=variables, check=True)


def test_the_compiler_is_loaded_without_scipy_and_kernels_find_it():
    program = """
import sys
import gslcosim, numba
import numpy as np

@numba.njit
def double(x):
    return x + x

double(1)
assert "scipy.linalg" not in sys.modules
ones = np.ones((2, 2))
assert numba.njit(lambda a: np.kron(a, a))(ones).sum() == 16
assert (numba.njit(lambda a: a @ a)(ones) == 2).all()
assert "scipy.linalg" in sys.modules
"""
    subprocess.run([sys.executable, "-c", program], check=True)


@pytest.mark.parametrize(
    ("flags", "expected"),
    [
        ("pni ssse3 sse4_1 sse4_2 popcnt cx16 lahf_lm avx avx2 bmi1 bmi2 f16c fma abm movbe xsave", "x86-64-v3"),
        ("pni ssse3 sse4_1 sse4_2 popcnt cx16 lahf_lm avx", "x86-64-v2"),
        ("avx avx2 bmi1 bmi2 f16c fma abm movbe xsave", None),
        ("fp asimd", None),
    ],
)
def test_the_level_is_the_highest_whose_flags_are_all_there(flags, expected):
    assert choose_processor_level(flags.split()) == expected


def test_kernels_of_an_archive_are_signed_and_loaded_elsewhere(tmp_path, monkeypatch):
    """With another key, in a cache that knows nothing of where they were compiled."""
    to_next_border(0.5, 0, 1.0)
    here = Path(os.environ[NUMBA_VARIABLE])
    archive = tmp_path / "kernels.tar.xz"
    monkeypatch.setattr(kernel_archives, "get_archive_path", lambda _: archive)
    monkeypatch.setattr(kernel_archives, "get_code_roots", lambda: {"gslcosim": PACKAGE_DIR})
    assert pack() == [archive]
    there = tmp_path / "numba" / here.name
    monkeypatch.setenv(NUMBA_VARIABLE, str(there))
    assert not kernel_archives.has_all_archives()
    kernel_archives.unpack_archives()
    assert kernel_archives.has_all_archives()
    program = (
        "from gslcosim.environment.grid_kernels import to_next_border\n"
        "to_next_border(0.5, 0, 1.0)\n"
        "print(sum(to_next_border.stats.cache_hits.values()))"
    )
    call = [sys.executable, "-c", program]
    assert subprocess.run(call, capture_output=True, text=True, check=True).stdout == "1\n"
    assert get_key_path() == tmp_path / "kernels.key"
    assert {path.suffix for path in there.glob("gslcosim.*/*")} == {".nbi", ".nbc"}


@pytest.mark.slow
@pytest.mark.parametrize("ending", ["nbi", "nbc"])
def test_a_planted_file_is_not_loaded_and_its_kernel_is_compiled_again(cached, tmp_path, ending):
    path = files_in(tmp_path / "cache", ending)["program.twice"]
    mark = tmp_path / "loaded"
    for signature in (b"", path.read_bytes()[-32:]):
        path.write_bytes(pickle.dumps(Planted(mark)) + signature)
        cached()
        assert not mark.exists()
        assert cached() == 2
    pickle.loads(pickle.dumps(Planted(mark)))
    assert mark.exists()


def test_a_signed_file_in_place_of_another_counts_as_absent(cached, tmp_path):
    indexes = files_in(tmp_path / "cache", "nbi")
    shutil.copy(indexes["program.twice"], indexes["program.once"])
    assert cached() == 1


def give_away(path, folder):
    os.chown(path, 65534, 65534)


def replace_by_link(path, folder):
    path.rename(folder / "kept")
    path.symlink_to(folder / "kept")


@pytest.mark.slow
@pytest.mark.parametrize(
    "spoil",
    [
        lambda path, _: path.chmod(0o664),
        lambda path, _: path.chmod(0o646),
        pytest.param(give_away, marks=pytest.mark.skipif(os.geteuid() != 0, reason="only root can give files away")),
        replace_by_link,
    ],
    ids=["group may write", "others may write", "of another user", "link"],
)
def test_a_file_that_others_could_change_counts_as_absent(cached, tmp_path, spoil):
    spoil(files_in(tmp_path / "cache", "nbi")["program.twice"], tmp_path)
    assert cached() == 1


@pytest.mark.slow
@pytest.mark.skipif(os.geteuid() == 0 and shutil.which("setpriv") is None, reason="root may write everywhere")
def test_kernels_are_read_from_a_cache_that_cannot_be_written(cached, tmp_path):
    """Numba would compile them again, beside the sources; one that is not there is compiled, and the program runs."""
    indexes = files_in(tmp_path / "cache", "nbi")
    folder = indexes["program.once"].parent
    without_rights = ("setpriv", "--inh-caps=-all", "--bounding-set=-all") if os.geteuid() == 0 else ()
    try:
        folder.chmod(0o555)
        assert cached(prefix=without_rights) == 2
        folder.chmod(0o755)
        indexes["program.once"].unlink()
        folder.chmod(0o555)
        assert cached(prefix=without_rights) == 1
        assert cached(prefix=without_rights) == 1
    finally:
        folder.chmod(0o755)
    assert not list(tmp_path.glob("__pycache__/*.nb?"))


@pytest.mark.slow
@pytest.mark.skipif(os.geteuid() != 0 or shutil.which("setpriv") is None, reason="only root can become another user")
def test_kernels_that_root_has_compiled_are_read_by_others(cached, tmp_path):
    """The key of an image's cache is root's alone, who has also installed the code."""
    as_other = ("setpriv", "--reuid", "65534", "--clear-groups", "--inh-caps=+dac_read_search")
    as_other += ("--ambient-caps=+dac_read_search",)
    (tmp_path / "cache" / "kernels.key").rename(tmp_path / "cache" / "of_root.key")
    for folder in (tmp_path, *tmp_path.parents[:2]):
        folder.chmod(folder.stat().st_mode | 0o055)
    assert cached(prefix=as_other) == 2
    os.chown(files_in(tmp_path / "cache", "nbi")["program.once"], 65533, 65533)
    assert cached(prefix=as_other) == 1


@pytest.mark.slow
def test_a_key_that_others_may_have_written_is_made_again(cached, tmp_path):
    key = tmp_path / "cache" / "kernels.key"
    before = key.read_bytes()
    key.chmod(0o666)
    assert cached() == 0
    assert key.read_bytes() != before
    assert key.stat().st_mode & 0o777 == 0o600
    assert cached() == 2


@pytest.mark.slow
def test_a_folder_of_kernels_that_others_may_write_is_closed(cached, tmp_path, monkeypatch):
    (folder,) = (path for path in (tmp_path / "cache" / "numba").iterdir() if path.is_dir())
    folder.chmod(0o777)
    monkeypatch.setenv("GSLCOSIM_CACHE", str(tmp_path / "cache"))
    monkeypatch.delenv("NUMBA_CACHE_DIR")
    use_kernel_cache()
    assert folder.stat().st_mode & 0o777 == 0o755
    assert get_key_path() == tmp_path / "cache" / "kernels.key"
    if os.geteuid() == 0:
        os.chown(folder, 65534, 65534)
        monkeypatch.delenv("NUMBA_CACHE_DIR")
        use_kernel_cache()
        assert os.environ["NUMBA_CACHE_DIR"] == f"{folder}-0"


@pytest.mark.slow
def test_another_level_of_optimisation_has_kernels_of_its_own(cached):
    """Numba would load those of the level before, which may differ in last bits."""
    assert cached(NUMBA_OPT="0") == 0
    assert cached(NUMBA_OPT="0") == 2
    assert cached() == 2


@pytest.mark.slow
def test_an_agent_that_has_no_key_reads_signed_files_as_numba_does(cached, tmp_path):
    """A sandbox shows them and hides the key; what it compiles besides is not kept."""
    folder = files_in(tmp_path / "cache", "nbi")["program.twice"].parent
    variables = os.environ | {
        "NUMBA_CACHE_DIR": str(folder.parent),
        "GSLCOSIM_UNCHECKED_KERNELS": "1",
        "GSLCOSIM_CACHE": str(tmp_path / "nothing"),
    }
    ran = subprocess.run(
        [sys.executable, str(tmp_path / "program.py")], env=variables, capture_output=True, text=True, check=True
    )
    assert ran.stdout == "2\n"
    assert not (tmp_path / "nothing").exists()
    files_in(tmp_path / "cache", "nbi")["program.once"].unlink()
    subprocess.run([sys.executable, str(tmp_path / "program.py")], env=variables, check=True)
    assert "program.once" not in files_in(tmp_path / "cache", "nbi")


@pytest.mark.slow
def test_who_inherits_the_folder_and_has_another_cache_shares_the_kernels(cached, tmp_path):
    """With a key of its own it would compile and sign all of them, and after it everybody else would."""
    (folder,) = (path for path in (tmp_path / "cache" / "numba").iterdir() if path.is_dir())
    inherited = {
        "NUMBA_CACHE_DIR": str(folder),
        OWNER_VARIABLE: str(PACKAGE_DIR),
        EXTENSIONS_VARIABLE: os.environ[EXTENSIONS_VARIABLE],
    }
    assert cached(GSLCOSIM_CACHE=str(tmp_path / "other"), **inherited) == 2
    assert not (tmp_path / "other" / "kernels.key").exists()
    assert cached() == 2


def test_another_copy_of_the_code_does_not_inherit_the_folder():
    show = "import os, gslcosim; print(os.environ['NUMBA_CACHE_DIR'])"
    folder = os.environ["NUMBA_CACHE_DIR"]

    def folder_of_child(**variables):
        return subprocess.run(
            [sys.executable, "-c", show], env=os.environ | variables, capture_output=True, text=True, check=True
        ).stdout.strip()

    assert folder_of_child() == folder
    stale = folder + "-of-another-copy"
    assert folder_of_child(NUMBA_CACHE_DIR=stale, NUMBA_CACHE_OF_GSLCOSIM="/another/copy") == folder
    assert folder_of_child(NUMBA_CACHE_DIR=stale, NUMBA_CACHE_OF_GSLCOSIM="") != stale
    chosen_by_user = {k: v for k, v in os.environ.items() if k != "NUMBA_CACHE_OF_GSLCOSIM"}
    shown = subprocess.run(
        [sys.executable, "-c", show], env=chosen_by_user | {"NUMBA_CACHE_DIR": stale}, capture_output=True, text=True
    )
    assert shown.stdout.strip() == stale
