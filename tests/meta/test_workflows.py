"""Workflows of the forge, read as data: pinned actions, least rights, no stored secret, and a release from a tag alone."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import pytest
import yaml
from places import ROOT

FOLDER = ROOT / ".github" / "workflows"
FILES = sorted(FOLDER.glob("*.y*ml"))
PINNED = re.compile(r"^\s*-?\s*uses: ([\w.-]+/[\w./-]+)@([0-9a-f]{40}) # (v\d+\.\d+\.\d+)$")


def workflow(path: Path) -> dict[Any, Any]:
    """Content of a file; YAML 1.1 reads its key ``on`` as the truth value True."""
    return yaml.safe_load(path.read_text("utf-8"))


def steps(path: Path) -> list[dict[str, Any]]:
    return [step for job in workflow(path)["jobs"].values() for step in job["steps"]]


def test_there_are_workflows_of_tests_and_of_the_release():
    assert [path.name for path in FILES] == ["release.yml", "tests.yml"]


@pytest.mark.parametrize("path", FILES, ids=lambda path: path.name)
def test_actions_are_pinned_by_commit_with_the_version_beside_it(path):
    lines = [line for line in path.read_text("utf-8").splitlines() if "uses:" in line]
    assert len(lines) == sum("uses" in step for step in steps(path)) > 0
    assert [line for line in lines if not PINNED.match(line)] == []


def test_an_action_has_one_commit_in_all_workflows():
    pins: dict[str, set[tuple[str, str]]] = {}
    for line in "\n".join(path.read_text("utf-8") for path in FILES).splitlines():
        if found := PINNED.match(line):
            pins.setdefault(found[1], set()).add((found[2], found[3]))
    assert {action: commits for action, commits in pins.items() if len(commits) != 1} == {}


@pytest.mark.parametrize("path", FILES, ids=lambda path: path.name)
def test_no_workflow_has_a_secret_or_runs_code_of_strangers_with_rights(path):
    content, text = workflow(path), re.sub(r"^\s*#.*$", "", path.read_text("utf-8"), flags=re.MULTILINE)
    assert not re.search(r"\bsecrets\b|password|(?<!id-)token:|api[-_]key", text)
    assert not {"pull_request_target", "workflow_run"} & set(content[True])
    assert not [step["run"] for step in steps(path) if "${{" in step.get("run", "")], "text of others within a command"


@pytest.mark.parametrize("path", FILES, ids=lambda path: path.name)
def test_rights_are_the_least(path):
    content = workflow(path)
    assert content["permissions"] in ({}, {"contents": "read"})
    for name, job in content["jobs"].items():
        granted = job.get("permissions", {})
        wanted = {"attest": {"attestations": "write", "id-token": "write"}, "publish": {"id-token": "write"}}
        assert granted in ({}, {"contents": "read"}) or (path.name == "release.yml" and granted == wanted[name]), name
        if granted.get("id-token"):
            assert not [step for step in job["steps"] if "run" in step], f"{name} runs code beside the right to sign"
    for step in steps(path):
        if step.get("uses", "").startswith("actions/checkout@"):
            assert step["with"]["persist-credentials"] is False


def test_a_release_starts_from_a_tag_of_a_version_alone():
    assert workflow(FOLDER / "release.yml")[True] == {"push": {"tags": ["v*"]}}


def test_what_is_published_is_what_was_checked():
    """The checks of `make release-check` leave the files; later jobs build nothing, attest those files, then publish them."""
    jobs = workflow(FOLDER / "release.yml")["jobs"]
    assert list(jobs) == ["build", "attest", "publish"]
    assert (jobs["attest"]["needs"], jobs["publish"]["needs"]) == ("build", "attest")
    commands = [step["run"] for step in jobs["build"]["steps"] if "run" in step]
    assert commands == ['python -m tools.release --check "$GITHUB_REF_NAME"', "make release-check LOCKED=1 DIST=dist"]
    assert jobs["build"]["steps"][-2]["env"] == {"TWISTWRENCH_ON_INDEX": "1"}, "messages name the index"
    kept = jobs["build"]["steps"][-1]
    assert kept["uses"].startswith("actions/upload-artifact@") and kept["with"]["path"] == "dist/"
    for name in ("attest", "publish"):
        taken = jobs[name]["steps"][0]
        assert taken["uses"].startswith("actions/download-artifact@")
        assert (taken["with"]["name"], taken["with"]["path"]) == (kept["with"]["name"], "dist/")
    assert jobs["attest"]["steps"][1]["uses"].startswith("actions/attest-build-provenance@")
    assert jobs["attest"]["steps"][1]["with"] == {"subject-path": "dist/*"}
    assert jobs["publish"]["steps"][1]["uses"].startswith("pypa/gh-action-pypi-publish@")
    assert jobs["publish"]["environment"]["name"] == "pypi"


@pytest.mark.parametrize("path", FILES, ids=lambda path: path.name)
def test_commands_of_make_exist(path):
    targets = set(re.findall(r"^([\w-]+):", (ROOT / "Makefile").read_text("utf-8"), re.MULTILINE))
    called = re.findall(r"\bmake ([\w-]+)", "\n".join(step.get("run", "") for step in steps(path)))
    assert called and set(called) <= targets
