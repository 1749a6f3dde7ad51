"""`gslcosim schema`"""

import json

from contract_files import build_contract_files
from file_schemas import MODELS, build_schema_text

from gslcosim.cli.main import main
from gslcosim.contract.version import CONTRACT_HASH


def test_export_writes_all_files(capsys, tmp_path):
    assert main(["schema", "export", str(tmp_path / "new" / "contract")]) == 0
    assert CONTRACT_HASH in capsys.readouterr().out
    folder = tmp_path / "new" / "contract"
    written = {path.relative_to(folder).as_posix(): path.read_text() for path in folder.rglob("*.*")}
    assert written == build_contract_files()


def test_a_folder_that_cannot_be_written_is_a_wrong_call(capsys, tmp_path):
    (tmp_path / "file").write_text("")
    assert main(["schema", "export", str(tmp_path / "file" / "contract")]) == 2
    assert "expected a folder that can be written" in capsys.readouterr().err


def test_schemas_of_files_are_written_for_editors(capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert main(["schema", "files"]) == 0
    assert capsys.readouterr().out.endswith("# yaml-language-server: $schema=schemas/scenario.schema.json\n")
    written = {path.name: path.read_text() for path in (tmp_path / "schemas").iterdir()}
    assert written == {f"{kind}.schema.json": build_schema_text(kind) for kind in MODELS}
    assert main(["schema", "files", "other", "--json"]) == 0
    assert sorted(json.loads(capsys.readouterr().out)["files"]) == sorted(written)
