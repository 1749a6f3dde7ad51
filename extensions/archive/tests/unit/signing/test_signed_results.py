"""Signed results: what differs from what was signed is found and named, whatever was altered."""

import hashlib
import json
import re
import shutil
import subprocess
from functools import cache

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from gslcosim.base.errors import UsageError
from gslcosim.cli.main import main
from gslcosim_archive.signing.keys import NAMESPACE, SignatureError, parse_author, sign_digest, write_key
from gslcosim_archive.signing.signed_results import check_signature, sign_results
from gslcosim_archive.site.writer import write_site
from gslcosim_bench.store import TRIALS
from gslcosim_bench.verification_marks import find_mark, remove_caches, results_hash

N_ALTERATIONS = 1000


@pytest.fixture
def folder(signed_once, tmp_path):
    return shutil.copytree(signed_once, tmp_path / "results")


def rows_of(folder):
    """Return copies of the rows of a folder that no test has altered yet."""
    return [dict(row) for row in read_rows((folder / "trials.parquet").read_bytes())]


@cache
def read_rows(content):
    return pq.read_table(pa.BufferReader(content)).to_pylist()


def write_rows(folder, rows):
    table = pa.Table.from_pylist(rows, schema=TRIALS)
    pq.write_table(table, folder / "trials.parquet", compression=None, use_dictionary=False, write_statistics=False)


def error_of(folder, **options):
    with pytest.raises(SignatureError) as caught:
        check_signature(folder, **options)
    return str(caught.value)


def flip_bit(folder, rng):
    path = pick_file(folder, rng)
    data = bytearray(path.read_bytes())
    data[rng.integers(len(data))] ^= 1 << rng.integers(8)
    path.write_bytes(data)
    return ""


def cut_file(folder, rng):
    path = pick_file(folder, rng)
    path.write_bytes(path.read_bytes()[: rng.integers(path.stat().st_size)])
    return ""


def change_figure(folder, rng):
    rows = rows_of(folder)
    row = rows[rng.integers(len(rows))]
    name = rng.choice([field.name for field in TRIALS if row[field.name] is not None and field.name != "trial"])
    value = row[name]
    row[name] = (
        not value if isinstance(value, bool) else f"{value}x" if isinstance(value, str)
        else value + 1 if isinstance(value, int) else float(np.nextafter(value, np.inf))
    )  # fmt: skip
    write_rows(folder, rows)
    return rf"row of trial {row['trial']} \(.*\) was altered"


def drop_row(folder, rng):
    rows = rows_of(folder)
    row = rows.pop(rng.integers(len(rows)))
    write_rows(folder, rows)
    return f"row of trial {row['trial']} was removed"


def swap_rows(folder, rng):
    rows = rows_of(folder)
    i, j = rng.choice(len(rows), 2, replace=False)
    rows[i], rows[j] = rows[j], rows[i]
    write_rows(folder, rows)
    return "rows stand in another order"


def swap_figures(folder, rng):
    """Give two trials each other's results, under their own ids."""
    rows = rows_of(folder)
    i, j = rng.choice(len(rows), 2, replace=False)
    rows[i]["trial"], rows[j]["trial"] = rows[j]["trial"], rows[i]["trial"]
    write_rows(folder, rows)
    return f"row of trial {rows[i]['trial']} "


def add_row(folder, rng):
    rows = rows_of(folder)
    rows.append({**rows[rng.integers(len(rows))], "trial": "0" * 24})
    write_rows(folder, rows)
    return f"row of trial {'0' * 24} .* was added"


def repeat_row(folder, rng):
    rows = rows_of(folder)
    rows.append(rows[rng.integers(len(rows))])
    write_rows(folder, rows)
    return "trials.parquet: was altered"


def change_manifest(folder, rng):
    path = folder / "manifest.json"
    values = json.loads(path.read_text())
    values[rng.choice(sorted(values))] = int(rng.integers(1 << 30))
    path.write_text(json.dumps(values))
    return "manifest.json: was altered"


def swap_files(folder, rng):
    a, b = (path for path in rng.permutation(sorted(folder.rglob("*"))).tolist() if path.is_file()), None
    a, b = next(a), next(a)
    content = a.read_bytes()
    a.write_bytes(b.read_bytes())
    b.write_bytes(content)
    return ""


def remove_file(folder, rng):
    path = pick_file(folder, rng)
    path.unlink()
    return path.name


def add_file(folder, rng):
    name = f"agents/mine/{rng.integers(1 << 30)}.py"
    (folder / name).touch()
    return f"{name}: was added"


def link_file(folder, rng):
    path = pick_file(folder, rng)
    target = folder.parent / "elsewhere"
    target.write_bytes(path.read_bytes() + b" ")
    path.unlink()
    path.symlink_to(target)
    return ""


def forge_statement(folder, rng):
    """Write another figure, and the statement that would belong to it."""
    change_figure(folder, rng)
    statement = json.loads((folder / "signed.json").read_text())
    statement["rows"][rng.choice(sorted(statement["rows"]))] = "0" * 64
    (folder / "signed.json").write_text(json.dumps(statement, indent=0) + "\n")
    return "signature of what stands beside it"


ALTERATIONS = (
    flip_bit, flip_bit, cut_file, change_figure, change_figure, drop_row, swap_rows, swap_figures, add_row, repeat_row,
    change_manifest, swap_files, remove_file, add_file, link_file, forge_statement,
)  # fmt: skip


def pick_file(folder, rng):
    paths = [path for path in sorted(folder.rglob("*")) if path.is_file()]
    return paths[rng.integers(len(paths))]


@pytest.mark.slow
def test_every_alteration_is_found(folder):
    """A thousand of them, drawn by a seed: bits, figures, rows and files; each is named."""
    pristine = {path: path.read_bytes() for path in folder.rglob("*") if path.is_file()}
    missed = []
    for seed in range(N_ALTERATIONS):
        rng = np.random.default_rng(seed)
        alter = ALTERATIONS[seed % len(ALTERATIONS)]
        expected = alter(folder, rng)
        try:
            check_signature(folder)
        except SignatureError as error:
            if not re.search(expected, str(error)):
                missed.append((seed, alter.__name__, str(error)))
        else:
            missed.append((seed, alter.__name__, "not found"))
        for path in folder.rglob("*"):
            if path.is_symlink() or (path.is_file() and path not in pristine):
                path.unlink()
        for path, content in pristine.items():
            if not path.is_file() or path.read_bytes() != content:
                path.write_bytes(content)
    assert missed == []
    assert check_signature(folder) is not None


def test_a_signed_folder_says_who_signed_it_and_reports_change_nothing(folder, key):
    (folder / "report.html").write_text("a report")
    (folder / "recordings").mkdir()
    signed = check_signature(folder, author=parse_author(f"{key}.pub"))
    assert (signed.author, signed.signed_at, signed.suite) == ("Ada", "2026-11-27T12:00:00+00:00", "synthetic")
    assert signed.n_rows == len(rows_of(folder))
    assert parse_author(signed.key.text) == parse_author(signed.key.fingerprint) == signed.key.fingerprint


def test_a_signature_leaves_the_mark_of_a_verification(folder):
    before = results_hash(folder)
    for name in ("signed.json", "signed.json.sig"):
        (folder / name).unlink()
    assert results_hash(folder) == before
    assert check_signature(folder) is None
    assert "were unsigned ones" in error_of(folder, author="SHA256:" + "A" * 43)


@pytest.mark.parametrize("name", ["signed.json", "signed.json.sig"])
def test_links_to_statement_and_signature_are_refused(folder, name):
    (folder / name).rename(folder.parent / "elsewhere")
    (folder / name).symlink_to(folder.parent / "elsewhere")
    assert f"{name}: expected a plain file, was a link" in error_of(folder)


def test_contents_that_hashes_of_files_miss_are_refused(folder, key):
    """A link to what is not signed could be signed, and Python runs its caches whatever the source says."""
    rows, outside, caches = folder / "trials.parquet", folder / "recordings", folder / "agents" / "mine" / "__pycache__"
    outside.mkdir()
    shutil.move(rows, outside / "rows")
    rows.symlink_to("recordings/rows")
    statement = json.loads((folder / "signed.json").read_text())
    statement["files"]["trials.parquet"] = "link to recordings/rows"
    resign(folder, key, statement)
    assert "trials.parquet: is a link; put the file" in error_of(folder)
    with pytest.raises(UsageError, match=r"trials\.parquet: is a link"):
        results_hash(folder)
    rows.unlink()
    shutil.move(outside / "rows", rows)
    sign_results(folder, key, author="", signed_at="")
    before = results_hash(folder)
    caches.mkdir()
    (caches / "helper.cpython-311.pyc").write_bytes(b"other code")
    assert "agents/mine/__pycache__: is a cache of Python" in error_of(folder)
    for refuse in (results_hash, lambda place: sign_results(place, key, author="", signed_at="")):
        with pytest.raises(UsageError, match="is a cache of Python"):
            refuse(folder)
    assert find_mark(folder) is None
    remove_caches(folder)
    assert results_hash(folder) == before


def test_a_statement_is_compared_with_its_folder_and_its_key(folder, key, tmp_path):
    """An author can sign anything, and anybody what an author has written."""
    signed = json.loads((folder / "signed.json").read_text())
    for change, what in (
        ({"rows": {}}, r"trials\.parquet: row of trial .* was added"),
        ({"suite_hash": "other"}, r"signed\.json: says suite_hash other, manifest\.json says "),
        ({"suite": "open_2026"}, r"signed\.json: says suite open_2026, manifest\.json says synthetic"),
    ):
        resign(folder, key, {**signed, **change})
        assert re.search(what, error_of(folder))
    write_key(tmp_path / "eve", "")
    resign(folder, tmp_path / "eve", signed)
    assert "Somebody else has signed it" in error_of(folder)


def resign(folder, key, statement):
    """Sign a statement that gslcosim would not write."""
    content = (json.dumps(statement, indent=0) + "\n").encode()
    (folder / "signed.json").write_bytes(content)
    (folder / "signed.json.sig").write_text(sign_digest(hashlib.sha256(content).digest(), key)[0])


def test_another_key_is_another_author(folder, key, tmp_path):
    """Somebody who alters results and signs them again is found by the key that the author has published."""
    change_figure(folder, np.random.default_rng(0))
    write_key(tmp_path / "eve", "eve")
    sign_results(folder, tmp_path / "eve", author="Ada", signed_at="2026-11-27T12:00:00+00:00")
    assert check_signature(folder) is not None
    assert "were signed by SHA256:" in error_of(folder, author=parse_author(f"{key}.pub"))


@pytest.mark.skipif(shutil.which("ssh-keygen") is None, reason="needs OpenSSH")
def test_openssh_checks_our_signatures_and_its_keys_sign(folder, tmp_path):
    """Anybody can check a statement without gslcosim, and sign with the key that they have."""
    statement = (folder / "signed.json").read_bytes()
    check = ["ssh-keygen", "-Y", "check-novalidate", "-n", NAMESPACE, "-s", folder / "signed.json.sig"]
    good = subprocess.run(check, input=statement, capture_output=True, check=False)
    assert good.returncode == 0, good.stderr
    assert check_signature(folder).key.fingerprint in good.stdout.decode()
    assert subprocess.run(check, input=statement + b" ", capture_output=True, check=False).returncode != 0
    subprocess.run(["ssh-keygen", "-q", "-t", "ed25519", "-N", "", "-f", tmp_path / "theirs"], check=True)
    signed = sign_results(folder, tmp_path / "theirs", author="", signed_at="")
    shown = subprocess.run(["ssh-keygen", "-l", "-f", tmp_path / "theirs.pub"], capture_output=True, check=True)
    assert signed.key.fingerprint in shown.stdout.decode()


def test_what_cannot_sign_is_refused(folder, key, tmp_path):
    with pytest.raises(UsageError, match="was a file that is there"):
        write_key(key, "")
    assert key.stat().st_mode & 0o077 == 0
    for path, why in ((tmp_path / "none", "without a passphrase"), (folder / "suite.yaml", "bench keygen")):
        with pytest.raises(UsageError, match=why):
            sign_results(folder, path, author="", signed_at="")
    (folder / "rows.jsonl").touch()
    with pytest.raises(UsageError, match="of an interrupted one"):
        sign_results(folder, key, author="", signed_at="")
    (folder / "rows.jsonl").unlink()
    (folder / "agents" / "link").symlink_to("/etc/passwd")
    with pytest.raises(UsageError, match="agents/link: is a link"):
        sign_results(folder, key, author="", signed_at="")
    (folder / "agents" / "link").unlink()
    shutil.copy(key, folder / "agents" / "mine" / "k")
    with pytest.raises(UsageError, match="k: expected a file for everybody, was a private key"):
        sign_results(folder, key, author="", signed_at="")
    for refuse in (
        lambda: sign_results(folder, key, author="\udcff", signed_at=""),
        lambda: write_key(tmp_path / "key", "\udcff"),
    ):
        with pytest.raises(UsageError, match="--name: expected a text in UTF-8"):
            refuse()
    assert not (tmp_path / "key").exists()
    with pytest.raises(UsageError, match="--author: expected an Ed25519 key"):
        parse_author("ssh-ed25519 AAAA")


def test_the_command_line_makes_a_key_signs_and_checks(folder, tmp_path, capsys):
    key = str(tmp_path / "key")
    assert main(["bench", "keygen", key, "--name", "ada"]) == 0
    assert main(["bench", "sign", str(folder), "--key", key, "--name", "Ada"]) == 0
    check = ["bench", "verify", str(folder), "--signature-only", "--author", f"{key}.pub", "--json"]
    capsys.readouterr()
    assert main(check) == 0
    assert json.loads(capsys.readouterr().out)["signature"]["rows"] == len(rows_of(folder))
    (folder / "maps.json").write_text("{}")
    assert main(check) == 2
    assert "maps.json: was added" in capsys.readouterr().err


def test_a_site_shows_who_has_signed_and_none_is_made_of_altered_results(folder, tmp_path):
    key = check_signature(folder).key.fingerprint
    write_site([folder], tmp_path / "site")
    assert f'title="signed with the key {key}"' in (tmp_path / "site" / "index.html").read_text()
    assert f"<dt>signed</dt><dd>with the key {key}</dd>" in (tmp_path / "site" / "methods" / "e_coli.html").read_text()
    (folder / "agents" / "mine" / "agent.py").write_text("print('another agent')\n")
    with pytest.raises(SignatureError):
        write_site([folder], tmp_path / "other")
    assert not (tmp_path / "other").exists()
