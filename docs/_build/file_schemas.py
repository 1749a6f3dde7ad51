"""JSON Schemas of the files that users write, for editors: `make contract` writes them beside the bundled files.

A file's first line names its schema by a relative path; `gslcosim.base.bundled.bundled_schemas` says where each is.
"""

import json
from typing import Any

from pydantic import BaseModel

from gslcosim.base.bundled import bundled_schemas
from gslcosim.methods.card import MethodCard, list_shared_parameters
from gslcosim.scenario.models.scenario import Scenario
from gslcosim_bench.cases.families import FamilySpec
from gslcosim_bench.cases.models import Suite
from gslcosim_training.train_file import TrainSpec

MODELS: dict[str, type[BaseModel]] = {
    "scenario": Scenario, "suite": Suite, "method": MethodCard, "family": FamilySpec, "train": TrainSpec,
}  # fmt: skip
DIALECT = "https://json-schema.org/draft/2020-12/schema"
# Places that a scenario may let gslcosim draw: of sources, and where vehicles start.
_DRAWN_PLACES = ("position_m", "start_m")
_RANDOM = {"const": "random"}


def build_file_schema(name: str) -> dict[str, Any]:
    """Return the JSON Schema of a kind of file as plain values.

    It is what the models say, and what loaders understand before them: places that are `random`, and what cards
    include. Rules between fields are not in it; `gslcosim validate` tells those.

    Args:
        name: One of `MODELS`.
    """
    schema = MODELS[name].model_json_schema(by_alias=True)
    if name == "scenario":
        _allow_random_places(schema)
    if name == "method":
        included = {"type": "array", "items": {"enum": list_shared_parameters()}}
        schema["properties"]["includes"] = {**included, "description": "parameters that several methods share"}
    return {"$schema": DIALECT, **schema, "title": f"{name} file of gslcosim"}


def _allow_random_places(schema: dict[str, Any]) -> None:
    for block in schema["$defs"].values():
        properties = block.get("properties", {})
        for key in _DRAWN_PLACES:
            if key in properties:
                properties[key] = {"anyOf": [properties[key], _RANDOM]}


def build_schema_text(name: str) -> str:
    """Return the content of the schema's file."""
    return json.dumps(build_file_schema(name), indent=1, ensure_ascii=False) + "\n"


if __name__ == "__main__":
    for kind, path in bundled_schemas().items():
        path.parent.mkdir(exist_ok=True)
        path.write_text(build_schema_text(kind), encoding="utf-8")
