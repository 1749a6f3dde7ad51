"""agents/contract is what the code says, whole, and any validator can use it."""

import json
import os
import shutil
import subprocess
from pathlib import Path

import jsonschema
import pytest
import yaml
from contract_files import build_contract_files
from contract_hash import hash_schemas

from gslcosim.base.errors import ContractError
from gslcosim.contract import codec
from gslcosim.contract.participant_messages import PARTICIPATION_VERSION
from gslcosim.contract.version import CONTRACT_HASH, CONTRACT_VERSION
from gslcosim.gateway import frame_codec
from gslcosim_conformance.key_table import AGENT_PLACEHOLDER, KEY_TABLE
from gslcosim_conformance.message_schemas import list_message_types, list_published_types

FOLDER = Path(__file__).parents[2] / "agents" / "contract"
TYPES = {item.__name__: item for item in list_published_types()}
ASYNCAPI_SPECS = "@asyncapi/specs@6.11.1"


def vectors(kind):
    """Return the checked-in cases of all messages as (message, case)."""
    files = [json.loads(path.read_text()) for path in sorted(FOLDER.glob("vectors/*.json"))]
    return [pytest.param(f["message"], case, id=f"{f['message']}-{case['name']}") for f in files for case in f[kind]]


def schema_of(message):
    return json.loads((FOLDER / "schemas" / f"{message}.json").read_text())


def forms_of(case):
    """Return each form of a case with the function that reads it."""
    if "msgpack" in case:
        yield codec.decode_untrusted, bytes.fromhex(case["msgpack"])
    if "json" in case:
        yield codec.decode_json, case["json"].encode()
    if "json_hex" in case:
        yield codec.decode_json, bytes.fromhex(case["json_hex"])


def test_the_folder_is_what_the_code_says():
    found = {path.relative_to(FOLDER).as_posix(): path.read_text() for path in FOLDER.rglob("*") if path.is_file()}
    expected = build_contract_files()
    assert set(found) == set(expected), "`make contract` rewrites the folder"
    assert [name for name in expected if found[name] != expected[name]] == [], "`make contract` rewrites the folder"


def test_the_hash_is_that_of_the_messages():
    assert hash_schemas(list_message_types()) == CONTRACT_HASH, "`make contract` writes it"


def test_version_and_hash_can_be_read_without_any_code():
    index = json.loads((FOLDER / "contract.json").read_text())
    assert (index["version"], index["hash"]) == (CONTRACT_VERSION, CONTRACT_HASH)
    assert set(index["messages"]) == {item.__name__ for item in list_message_types()}
    own = index["participation"]
    assert (own["version"], own["hash"]) == (PARTICIPATION_VERSION, hash_schemas(list_published_types()))
    assert set(index["messages"]) | set(own["messages"]) == set(TYPES)


@pytest.mark.parametrize(("message", "case"), vectors("accept"))
def test_what_must_be_accepted_is(message, case):
    for read, written in forms_of(case):
        assert json.loads(codec.encode_json(read(TYPES[message], written))) == case["fields"]
    jsonschema.validate(case["fields"], schema_of(message), jsonschema.Draft202012Validator)
    if "json" in case:
        jsonschema.validate(json.loads(case["json"]), schema_of(message), jsonschema.Draft202012Validator)


@pytest.mark.parametrize(
    ("message", "case"), [case for case in vectors("accept") if case.values[1]["canonical"]]
)  # fmt: skip
def test_what_is_canonical_is_what_we_write(message, case):
    decoded = codec.decode(TYPES[message], bytes.fromhex(case["msgpack"]))
    assert codec.encode(decoded).hex() == case["msgpack"]
    assert codec.encode_json(decoded).decode() == case["json"]


@pytest.mark.parametrize(("message", "case"), vectors("reject"))
def test_what_must_be_rejected_is_with_one_line(message, case):
    for read, written in forms_of(case):
        with pytest.raises(ContractError) as caught:
            read(TYPES[message], written)
        assert str(caught.value).startswith(f"{message}: ")
        assert "\n" not in str(caught.value)


@pytest.mark.parametrize(("message", "case"), [case for case in vectors("reject") if "json" in case.values[1]])
def test_the_schema_finds_what_the_vectors_say_it_finds(message, case):
    try:
        fields = json.loads(case["json"])
    except json.JSONDecodeError:
        assert case["schema_refuses"], "what is no JSON never comes before a schema"
        return
    assert jsonschema.Draft202012Validator(schema_of(message)).is_valid(fields) is not case["schema_refuses"]


def through_the_gateway(text):
    """Return the command in a line of JSON, on the way that it takes in a run."""
    return codec.decode_untrusted(TYPES["Command"], frame_codec.decode_payload("json", text))


@pytest.mark.parametrize(("message", "case"), [case for case in vectors("accept") if case.values[0] == "Command"])
def test_the_gateway_accepts_the_same_commands(message, case):
    if "json" in case:
        assert json.loads(codec.encode_json(through_the_gateway(case["json"].encode()))) == case["fields"]


@pytest.mark.parametrize(("message", "case"), [case for case in vectors("reject") if case.values[0] == "Command"])
def test_the_gateway_rejects_the_same_commands(message, case):
    for read, written in forms_of(case):
        if read is codec.decode_json:
            with pytest.raises(ContractError):
                through_the_gateway(written)


@pytest.mark.parametrize("message", ["Briefing", "Observation", "Ending"])
@pytest.mark.parametrize("frame_format", ["msgpack", "json"])
def test_a_frame_is_the_message_with_its_name(message, frame_format):
    (case, *_) = (case.values[1] for case in vectors("accept") if case.values[0] == message)
    (frame,) = frame_codec.build_splitter(frame_format).feed(
        frame_codec.encode_message(frame_format, message, bytes.fromhex(case["msgpack"]))
    )
    fields = frame_codec.decode_fields(frame_format, frame.payload)
    assert fields.pop("message") == message
    assert json.loads(codec.dump_json_line(fields)) == case["fields"]


def test_the_documented_limits_are_the_gateway_s():
    document = yaml.safe_load((FOLDER / "asyncapi.yaml").read_text())
    for place in ("stdio", "tcp", "unix"):
        assert document["servers"][f"gateway_{place}"]["x-framing"]["maxFrameBytes"] == frame_codec.MAX_FRAME_BYTES


def references_in(tree):
    if isinstance(tree, dict):
        for word, value in tree.items():
            yield from [value] if word == "$ref" else references_in(value)
    elif isinstance(tree, list):
        for item in tree:
            yield from references_in(item)


def test_asyncapi_has_all_keys_and_its_references_lead_somewhere():
    document = yaml.safe_load((FOLDER / "asyncapi.yaml").read_text())
    assert document["info"]["x-contract-hash"] == CONTRACT_HASH
    addresses = {channel["address"] for channel in document["channels"].values()}
    assert addresses == {channel.key.replace(AGENT_PLACEHOLDER, "{agent}") for channel in KEY_TABLE}
    check_references(document)


def check_references(document):
    for reference in references_in(document):
        file, _, path = reference.partition("#")
        if file:
            assert (FOLDER / file).is_file(), reference
        here = document
        for part in path.strip("/").split("/") if path else ():
            here = here[part]


def test_the_document_for_participants_leads_somewhere():
    document = yaml.safe_load((FOLDER / "participation.yaml").read_text())
    assert document["info"]["x-contract-hash"] == hash_schemas(list_published_types())
    check_references(document)
    sent = [name for name, operation in document["operations"].items() if operation["action"] == "send"]
    assert sent == ["sayHello", "sendOutputs"]


def test_an_agent_operates_on_its_own_keys_only():
    document = yaml.safe_load((FOLDER / "asyncapi.yaml").read_text())
    for name, operation in document["operations"].items():
        channel = document["channels"][operation["channel"]["$ref"].rsplit("/", 1)[1]]
        assert channel["address"].startswith("agents/{agent}/"), name
        assert (operation["action"] == "send") is (channel["address"] == "agents/{agent}/command")


@pytest.fixture(scope="module")
def asyncapi_schema():
    """AsyncAPI's own schema, from its npm package; kept in the cache between runs."""
    home = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
    cache = Path(os.environ.get("GSLCOSIM_CACHE") or home / "gslcosim") / "asyncapi"
    path = cache / "node_modules" / "@asyncapi" / "specs" / "schemas" / "3.0.0-without-$id.json"
    if not path.is_file():
        if shutil.which("npm") is None:
            pytest.skip("AsyncAPI's schema comes from npm, which is not installed")
        cache.mkdir(parents=True, exist_ok=True)
        install = [
            "npm",
            "install",
            "--silent",
            "--no-save",
            "--ignore-scripts",
            "--prefix",
            str(cache),
            ASYNCAPI_SPECS,
        ]
        done = subprocess.run(install, capture_output=True, text=True, check=False)
        if done.returncode != 0:
            pytest.skip(f"npm could not install {ASYNCAPI_SPECS}: {done.stderr.strip()[:200]}")
    return json.loads(path.read_text())


@pytest.mark.slow
@pytest.mark.debian
def test_asyncapi_is_valid_by_its_published_schema(asyncapi_schema):
    validator = jsonschema.Draft7Validator(asyncapi_schema)
    for file in ("participation.yaml", "asyncapi.yaml"):
        document = yaml.safe_load((FOLDER / file).read_text())
        assert [error.message for error in validator.iter_errors(document)] == []
    document["channels"]["agents_agent_command"]["adres"] = "typo"
    assert not validator.is_valid(document)
