"""The doctor's report as an answer: the command's verdict, text and data, and paragraphs of alike findings."""

import json
import re
from dataclasses import replace

import pytest
from click.testing import CliRunner

import twistwrench as tw
from twistwrench.cli.main import main
from twistwrench.core.text import words_of_the_shell
from twistwrench.diagnosis import Finding, Severity

RUNS = {
    "sound": ("ur5", {}, []),
    "strict": ("quadruped", {"strict": True}, ["--strict"]),
    "one check": ("ur5", {"only": "impossible"}, ["--only", "impossible"]),
    "floating": ("quadruped", {"floating_base": True}, ["--floating-base"]),
}
"""Robot, arguments of the function, and words of the command."""


@pytest.mark.parametrize("name", RUNS)
@words_of_the_shell()
def test_the_function_and_the_command_give_the_same_answer(name, tmp_path):
    robot, arguments, words = RUNS[name]
    path = tmp_path / "answer.json"
    result = CliRunner().invoke(main, ["doctor", robot, *words, "--json", str(path)])
    printed = json.loads(path.read_text("utf-8"))
    answer = tw.doctor(robot, **arguments)
    data = answer.to_dict()
    assert answer.verdict.exit_code == result.exit_code == data["exit_code"] == answer.exit_code(strict=answer.strict)
    for key in ("verdict", "reasons", "sentences", "checks", "findings", "source"):
        assert data[key] == printed[key], key
    assert re.sub(r"\s+", " ", result.output).startswith(answer.headline)


def many_placeholders(count):
    links = "".join(
        f'<link name="l{k}"><inertial><mass value="0.2"/><inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial>'
        "</link>"
        for k in range(count)
    )
    joints = "".join(
        f'<joint name="j{k}" type="revolute"><parent link="l{k - 1}"/><child link="l{k}"/><origin xyz="0 0 0.1"/>'
        '<axis xyz="0 1 0"/><limit lower="-1" upper="1" effort="5" velocity="2"/></joint>'
        for k in range(1, count)
    )
    return f'<robot name="chain">{links}{joints}</robot>'


def test_findings_of_one_check_and_one_repair_are_one_paragraph_with_all_places():
    answer = tw.doctor(many_placeholders(14))
    assert len(answer.paragraphs) < len(answer.findings)
    assert sum(map(len, answer.paragraphs)) == len(answer.findings)
    found = answer.to_dict()["findings"]
    places = [place for finding in found for place in finding["places"]]
    assert sorted(place["where"] for place in places) == sorted(finding.where for finding in answer.findings)
    text = str(answer)
    assert len(text.splitlines()) <= 45
    assert f"All {len(answer.findings)} findings with lines: .print(every=True)" in text


def test_each_place_in_the_heading_of_a_paragraph_has_its_own_line():
    answer = tw.doctor(many_placeholders(4).replace("<link", "\n<link"))
    several = next(group for group in answer.paragraphs if len(group) > 1)
    places = [f"{finding.where} (line {finding.line})" for finding in several[:2]]
    assert len({finding.line for finding in several}) == len(several)
    assert ", ".join(places) in re.sub(r"\s+", " ", str(answer))


def test_every_finding_is_in_the_full_form_and_on_the_page(tmp_path):
    import io

    answer, out = tw.doctor(many_placeholders(7)), io.StringIO()
    answer.print(every=True, file=out)
    pages = answer.to_html(tmp_path / "page.html").read_text("utf-8")
    for finding in answer.findings:
        assert finding.where in re.sub(r"\s+", " ", out.getvalue())
        assert finding.where.replace("'", "&#x27;") in pages
    assert "findings with lines" not in pages and "findings with lines" not in out.getvalue()


def test_every_surface_has_the_word_and_the_counts(tmp_path):
    answer = tw.doctor(many_placeholders(4))
    assert not answer.verdict.ok and answer.verdict.reasons
    assert repr(answer) == f"<DoctorReport of chain: {answer.verdict.word}, {answer.summary}>"
    assert answer.summary in answer.headline
    assert answer.summary in re.sub(r"<[^>]+>", "", answer._repr_html_())
    assert json.loads(answer.to_json())["verdict"] == answer.verdict.word


def test_the_worst_finding_is_in_the_short_form_however_long_it_is():
    """A short form has 34 lines of findings; the sentence here takes 3,500 characters, 46 lines of 76."""
    longest = Finding("impossible", Severity.ERROR, "link 'forearm'", 3, "word " * 700)
    answer = replace(tw.doctor("ur5"), findings=(longest, *tw.doctor("ur5").findings))
    assert "link 'forearm', line 3" in str(answer)
    assert "friction" not in str(answer)


@pytest.mark.parametrize("strict", [False, True])
@pytest.mark.parametrize("name", ["ur5", "planar_2r"])
def test_the_exit_code_of_a_report_is_that_of_its_word(name, strict):
    """A robot with notes alone, and one with a warning: notes count in both or in neither."""
    report = tw.doctor(name, strict=strict)
    assert report.findings
    assert bool(report.exit_code()) == (report.verdict.word != "OK")
