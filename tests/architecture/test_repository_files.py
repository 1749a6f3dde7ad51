"""Workflows, forms, hooks and the citation name targets, tools and versions that exist."""

import re
from pathlib import Path

import yaml

import gslcosim

ROOT = Path(__file__).parents[2]
WORKFLOWS = sorted((ROOT / ".github" / "workflows").glob("*.yml"))


def load(path):
    return yaml.safe_load((ROOT / path).read_text())


def test_workflows_call_targets_of_the_makefile():
    targets = set(re.findall(r"^([a-z][a-z-]*):", (ROOT / "Makefile").read_text(), re.MULTILINE))
    called = set()
    for path in WORKFLOWS:
        for job in load(path)["jobs"].values():
            called |= set(job.get("strategy", {}).get("matrix", {}).get("target", []))
            steps = " ".join(step.get("run", "") for step in job["steps"])
            called |= set(re.findall(r"\bmake ([a-z][a-z-]*)", steps))
    assert {"check", "test", "test-all", "docs-site", "dist"} <= called <= targets


def test_the_citation_names_this_version():
    citation = load("CITATION.cff")
    assert citation["version"] == gslcosim.__version__
    assert {"cff-version", "title", "authors", "license", "message"} <= citation.keys()


def test_issue_forms_ask_for_something():
    forms = [path for path in (ROOT / ".github" / "ISSUE_TEMPLATE").glob("*.yml") if path.name != "config.yml"]
    for path in forms:
        form = load(path)
        assert form["name"], path
        assert form["description"], path
        assert any(part.get("validations", {}).get("required") for part in form["body"]), path


def test_the_checklist_of_a_pull_request_is_that_of_contributing():
    contributing = (ROOT / "CONTRIBUTING.md").read_text().split("## A pull request\n")[1].split("\n## ")[0]
    asked = re.findall(r"^- (.+?\.)(?: `\.venv.*)?$", contributing, re.MULTILINE)
    ticked = re.findall(r"^- \[ \] (.+)$", (ROOT / ".github" / "pull_request_template.md").read_text(), re.MULTILINE)
    assert [line.replace("the text above", "the text") for line in ticked] == asked


def test_hooks_call_tools_of_make_check():
    check = (ROOT / "Makefile").read_text().split("\ncheck:")[1].split("\n\n")[0]
    for hook in load(".pre-commit-config.yaml")["repos"][0]["hooks"]:
        assert f"$(BIN)/{Path(hook['entry'].split()[0]).name}" in check
