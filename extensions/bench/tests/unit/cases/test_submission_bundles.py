"""Submission bundles: the same files have one hash, and what is unpacked, built and flown is what was packed."""

import io
import os
import shutil
import sys
import tarfile
from pathlib import Path

import pytest

from gslcosim.base.bundled import bundled_scenarios
from gslcosim.base.errors import GslCosimError, UsageError
from gslcosim.cli.main import main
from gslcosim_bench.cases.submission_bundles import build_program, pack_bundle, prepare_bundles, unpack_bundle
from gslcosim_bench.cases.suite_files import agent_hash, find_suite, load_suite, write_suite

ONE_CASE = """schema: gslcosim/suite/1
name: x
scenarios: [tiny_room]
anchors: []
entries: [{name: surge, start: {python: surge_cast}}]
"""
CONFORMANCE = Path(__file__).parents[4] / "conformance" / "gslcosim_conformance"
TEMPLATE = CONFORMANCE / "templates" / "agents" / "python" / "agent.py"
CARD = """schema: gslcosim/method/1
title: Mine
family: reactive
summary: Flies up the wind while it smells gas.
paper: none yet
needs: {sensors: [gas, wind]}
"""
SUBMISSION = f"""schema: gslcosim/submission/1
entry: {{name: mine, start: {{python: agent.py}}}}
build: [[{sys.executable}, -c, "open('parts/built.txt', 'w').write('built')"]]
lock: [requirements.lock]
leaves_out: [parts/built.txt, notes]
"""


@pytest.fixture
def folder(tmp_path):
    """An author's folder: a program with data in a folder of its own, and what is not packed."""
    folder = tmp_path / "author" / "mine"
    for name, text in {
        "agent.py": TEMPLATE.read_text().replace("NAME", "mine"), "method.yaml": CARD, "submission.yaml": SUBMISSION,
        "requirements.lock": "", "parts/data.json": "{}", "notes/idea.txt": "x", ".git/config": "x",
        "__pycache__/agent.pyc": "x", "parts/built.txt": "x",
    }.items():  # fmt: skip
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text(text)
    return folder


def test_the_same_files_have_one_hash_wherever_and_whenever_they_are_packed(folder, tmp_path):
    first = pack_bundle(folder, tmp_path / "first.tar")
    assert first.files == ("agent.py", "method.yaml", "parts/data.json", "requirements.lock", "submission.yaml")
    other = tmp_path / "elsewhere"
    # In another order, at another time, with other rights of the group.
    for name in reversed(first.files):
        (other / name).parent.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(folder / name, other / name)
        (other / name).chmod(0o640)
        os.utime(other / name, (1, 1))
    assert pack_bundle(other, tmp_path / "second.tar").digest == first.digest
    assert (tmp_path / "first.tar").read_bytes() == (tmp_path / "second.tar").read_bytes()
    (other / "agent.py").chmod(0o755)
    assert pack_bundle(other, tmp_path / "second.tar").digest != first.digest


def test_an_organiser_flies_what_the_author_has_packed(folder, tmp_path):
    """The entry keeps its hash from the author's folder to the results, with every file of the bundle."""
    bundle = pack_bundle(folder, tmp_path / "mine.tar")
    with pytest.raises(UsageError, match="expected --build"):
        prepare_bundles([tmp_path / "mine.tar"], find_suite("smoke"), name="x", results=tmp_path / "r", builds=False)
    prepared = prepare_bundles(
        [tmp_path / "mine.tar"], find_suite("smoke"), name="x", results=tmp_path / "r", builds=True
    )
    suite = prepared.suite
    assert prepared.roots == {"mine": suite.parent / bundle.digest[:16]}
    loaded = load_suite(suite, is_flown=True)
    assert loaded.demands_sandbox
    assert [inner.suite.name for inner in loaded.included] == ["smoke"]
    (entry,) = loaded.suite.entries
    unpacked = suite.parent / bundle.digest[:16]
    assert (unpacked / "parts" / "built.txt").read_text() == "built"
    write_suite(loaded, tmp_path / "r")
    kept = load_suite(tmp_path / "r", is_flown=True)
    assert (tmp_path / "r" / "agents" / "mine" / "parts" / "data.json").is_file()
    hashes = {
        agent_hash(entry, suite.parent), agent_hash(kept.suite.entries[0], kept.directory),
        agent_hash(bundle.submission.entry, folder),
    }  # fmt: skip
    assert len(hashes) == 1
    # Data beside the program decides too.
    (unpacked / "parts" / "data.json").write_text("[]")
    assert agent_hash(entry, suite.parent) not in hashes


HEADERS = [
    "# yaml-language-server: $schema=../schemas/method.schema.json\n",
    "#yaml-language-server: $schema=file:///home/ada/method.schema.json\r\n",
    "\ufeff# yaml-language-server: $schema=schemas/method.schema.json\n",
    "# Mine.\n\n  # yaml-language-server: $schema=a.json\n# Yours.\n",
]


@pytest.mark.parametrize("header", HEADERS)
def test_files_for_others_name_no_schema_that_stays_behind(folder, tmp_path, header):
    """Packed, unpacked, and kept with results: a schema's path leads nowhere there, and the program has its hash."""
    (folder / "parts" / "built.txt").unlink()
    entry = pack_bundle(folder, tmp_path / "plain.tar").submission.entry
    before = agent_hash(entry, folder)
    (folder / "method.yaml").write_text(header + CARD, newline="")
    if "Mine" not in header:
        assert agent_hash(entry, folder) == before
    (folder / "parts" / "more.yml").write_text(header, newline="")
    (folder / "parts" / "text.txt").write_text(header, newline="")
    pack_bundle(folder, tmp_path / "mine.tar")
    suite = tmp_path / "suite.yaml"
    (tmp_path / "room.yaml").write_text(header + bundled_scenarios()["tiny_room"].read_text(), newline="")
    mine = "{name: mine, start: {python: author/mine/agent.py}}"
    suite.write_text(ONE_CASE.replace("tiny_room", "room.yaml").replace("entries: [", f"entries: [{mine}, "))
    loaded = load_suite(suite, is_flown=True)
    for _ in range(2):
        write_suite(loaded, tmp_path / "r")
    unpacked = unpack_bundle(tmp_path / "mine.tar", tmp_path / "bundles").root
    for kept in (unpacked, tmp_path / "r"):
        files = [*kept.rglob("*.yaml"), *kept.rglob("*.yml")]
        assert len(files) >= 2
        assert [path for path in files if b"yaml-language-server" in path.read_bytes()] == []
    assert agent_hash(entry, unpacked) == agent_hash(entry, folder)
    assert (unpacked / "parts" / "text.txt").read_bytes() == header.encode()
    assert b"schema.json" not in (unpacked / "parts" / "more.yml").read_bytes()
    assert b"yaml-language-server" in (folder / "method.yaml").read_bytes()


@pytest.mark.parametrize("word", ["HASH/agent.py", "x_bundles.yaml"])
def test_a_bundle_that_names_what_lies_beside_it_is_not_flown(folder, tmp_path, capsys, word):
    """Beside it lie rivals, and the suite: the folders that a command names are seen, and kept with the results."""
    text = SUBMISSION.replace("build: [[", "build: [] #")
    (folder / "submission.yaml").write_text(text)
    rival = pack_bundle(folder, tmp_path / "rival.tar").digest[:16]
    word = word.replace("HASH", rival)
    text = text.replace("python: agent.py", f"command: [sh, parts/data.json, {word}], door: stdio")
    (folder / "submission.yaml").write_text(text.replace("name: mine", "name: evil"))
    pack_bundle(folder, tmp_path / "evil.tar")
    (tmp_path / "x.yaml").write_text(ONE_CASE)
    bundles = ["--bundle", str(tmp_path / "rival.tar"), "--bundle", str(tmp_path / "evil.tar")]
    assert main(["bench", "run", str(tmp_path / "x.yaml"), *bundles, "--results", str(tmp_path / "r" / "x")]) == 2
    found = "expected a command that names files of its folder or of the system, was one that names something in"
    assert found in capsys.readouterr().err
    assert not (tmp_path / "r" / "x" / "agents").exists()


def test_a_build_that_fails_says_why(folder, tmp_path):
    text = SUBMISSION.replace("open('parts/built.txt', 'w').write('built')", "raise SystemExit('no compiler')")
    (folder / "submission.yaml").write_text(text)
    pack_bundle(folder, tmp_path / "mine.tar")
    with pytest.raises(UsageError, match=r"was exit code 1.*\nno compiler"):
        build_program(unpack_bundle(tmp_path / "mine.tar", tmp_path), is_agreed=True)


PRIVATE_KEY = "-----BEGIN OPENSSH PRIVATE KEY-----\nb3Bl"
SECRET = '{"schema": "gslcosim/seal/1", "seed": 1, "nonce": "0"}'


def edit(folder, old, new, *, builds=True):
    text = SUBMISSION if builds else SUBMISSION.replace("build: [[", "build: [] #")
    (folder / "submission.yaml").write_text(text.replace(old, new))


def start_with(folder, start, name="mine"):
    text = SUBMISSION.replace("python: agent.py", start).replace("name: mine", f"name: {name}")
    (folder / "submission.yaml").write_text(text)


@pytest.mark.parametrize(
    ("change", "what"),
    [
        (lambda folder: (folder / "method.yaml").unlink(), "expected the method's card, method.yaml"),
        (lambda folder: (folder / "requirements.lock").unlink(), "a file that lock names, requirements.lock"),
        (lambda folder: (folder / "submission.yaml").unlink(), "expected a folder with submission.yaml"),
        (lambda folder: (folder / "submission.yaml").write_text("schema: x"), "lock: expected"),
        (lambda folder: (folder / "link").symlink_to("/etc/passwd"), "expected a plain file, was a link"),
        (lambda folder: (folder / "data").symlink_to(folder / "parts"), "data: expected a plain file, was a link"),
        (lambda folder: (folder / "gone").symlink_to("nowhere"), "gone: expected a plain file, was a link"),
        (lambda folder: os.mkfifo(folder / "pipe"), "pipe: expected a plain file, was a pipe"),
        (lambda folder: (folder / "a\nb").touch(), "'a\\nb', with characters that are not shown"),
        (lambda folder: (folder / os.fsdecode(b"\xe9t\xe9")).touch(), "with characters that are not shown"),
        (lambda folder: (folder / "my_key").write_text(PRIVATE_KEY), "my_key: expected a file for everybody"),
        (lambda folder: (folder / "s.json").write_text(SECRET), "s.json: expected a file for everybody"),
        (lambda folder: edit(folder, "[requirements.lock]", "[.git/config]"), "expected .git/config to be packed"),
        (lambda folder: edit(folder, "[parts/", "[submission.yaml, parts/"), "expected submission.yaml to be packed"),
        (lambda folder: edit(folder, "[parts/built.txt", "['*.py'", builds=False), "names a file of the bundle"),
        (lambda folder: edit(folder, "python: agent.py", "command: [sh, -c, x], door: stdio", builds=False), "run.sh"),
        (lambda folder: start_with(folder, "python: ../x.py"), "entry.start: expected paths from this folder"),
        (lambda folder: start_with(folder, "command: [./a, ../../x], door: stdio"), "was ../../x"),
        (lambda folder: start_with(folder, "command: [a, --x=/etc/passwd], door: stdio"), "was /etc/passwd"),
        (lambda folder: start_with(folder, "command: [a, 'parts:/etc'], door: stdio"), "was /etc"),
        (lambda folder: start_with(folder, "command: [/usr/../tmp, agent.py], door: stdio"), "was /usr/../tmp"),
        (lambda folder: start_with(folder, "python: agent.py", name="oracle"), "that of an anchor, oracle"),
    ],
)
def test_what_cannot_be_packed_is_refused(folder, tmp_path, change, what):
    change(folder)
    with pytest.raises(GslCosimError) as caught:
        pack_bundle(folder, tmp_path / "mine.tar")
    assert what in str(caught.value)


def member(name, kind=tarfile.REGTYPE, content=b"x"):
    info = tarfile.TarInfo(name)
    info.type, info.size, info.linkname = kind, len(content) if kind == tarfile.REGTYPE else 0, "/etc/passwd"
    return info, content


def write_tar(path, members):
    with tarfile.open(path, "w") as tar:
        for info, content in members:
            info.pax_headers = {"path": info.name} if "\0" in info.name else {}
            tar.addfile(info, io.BytesIO(content))


def test_a_tar_of_what_pack_leaves_out_is_no_bundle(folder, tmp_path):
    """It would be run, and counted neither as part of the program nor of the results."""
    names = ("agent.py", "method.yaml", "submission.yaml", "requirements.lock")
    members = [member(name, content=(folder / name).read_bytes()) for name in names]
    write_tar(tmp_path / "evil.tar", [*members, member("notes/idea.txt")])
    below = tmp_path / "below"
    with pytest.raises(UsageError, match=r"was one with a file that pack leaves out: notes/idea\.txt"):
        unpack_bundle(tmp_path / "evil.tar", below)
    assert list(below.iterdir()) == []
    write_tar(tmp_path / "good.tar", members)
    bundle = unpack_bundle(tmp_path / "good.tar", below)
    (bundle.root / ".built").touch()
    with pytest.raises(UsageError, match="expected --build"):
        build_program(bundle, is_agreed=False)


def test_runs_leave_a_program_at_a_project_s_root_as_it_is(folder, tmp_path):
    """Results, bundles and what is packed lie within its folder then, and are no part of it."""
    edit(folder, "", "", builds=False)
    first = pack_bundle(folder, folder / "out.tar")
    assert pack_bundle(folder, folder / "out.tar").digest == first.digest
    (folder / "out.tar").unlink()
    suite = ONE_CASE.replace("anchors: []\nentries: [", "entries: [{name: mine, start: {python: agent.py}}, ")
    (folder / "notes" / "s.yaml").write_text(suite.replace("agent.py", "../agent.py"))
    loaded = load_suite(folder / "notes" / "s.yaml")
    before = agent_hash(loaded.suite.entries[0], loaded.directory)
    write_suite(loaded, folder / "results" / "s")
    pack_bundle(folder, folder / "mine.tar")
    prepare_bundles([folder / "mine.tar"], find_suite("smoke"), name="x", results=folder / "results/x", builds=False)
    assert agent_hash(loaded.suite.entries[0], loaded.directory) == before
    assert pack_bundle(folder, folder / "out.tar").digest == first.digest


@pytest.mark.parametrize(
    "members",
    [
        [member("/etc/x")], [member("../x")], [member("a/../../x")], [member("x", tarfile.SYMTYPE)],
        [member("x/a"), member("x//a")], [member("x"), member("x/a")], [member("x/a"), member("x")],
        [member("n" * 300)], [member(".built")], [member("__pycache__/a.pyc")], [member("a\0b")], [member("a\x1bb")],
        [member("\udce9t\udce9")],
        [member("x", tarfile.LNKTYPE)], [member("x", tarfile.FIFOTYPE)], [member("x"), member("x")], [member("x")], [],
    ],
)  # fmt: skip
def test_a_tar_that_reaches_outside_is_no_bundle(tmp_path, members):
    write_tar(tmp_path / "evil.tar", members)
    below = tmp_path / "below"
    with pytest.raises(UsageError, match=r"expected a bundle of gslcosim bench pack"):
        unpack_bundle(tmp_path / "evil.tar", below)
    assert not below.exists()
    for content in (b"", b"x" * 2000):
        (tmp_path / "evil.tar").write_bytes(content)
        with pytest.raises(UsageError, match=r"expected a bundle"):
            unpack_bundle(tmp_path / "evil.tar", below)


def test_the_command_line_packs_and_refuses(folder, tmp_path, capsys):
    out = str(tmp_path / "mine.tar")
    assert main(["bench", "pack", str(folder), "--out", out]) == 0
    assert "SHA-256" in capsys.readouterr().out
    assert main(["bench", "run", "smoke", "--build"]) == 2
    assert main(["bench", "run", "smoke", "--bundle", out, "--results", str(tmp_path / "r")]) == 2
    assert "which run with all your rights" in capsys.readouterr().err
