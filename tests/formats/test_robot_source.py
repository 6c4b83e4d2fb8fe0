"""Where robot text comes from: files, folders and text itself, in any encoding, and what is refused unread."""

from __future__ import annotations

import pytest

from twistwrench.core.errors import ModelError, NotFoundError, RobotFileError, TwistWrenchError
from twistwrench.formats import load_model as load
from twistwrench.formats import source

BASE = '<link name="base"/>'


def robot(*elements: str) -> str:
    """A robot with one element a line, the first one on line 2."""
    return "\n".join(['<robot name="r">', *elements, "</robot>"])


def test_the_error_names_the_file(tmp_path):
    path = tmp_path / "arm.urdf"
    path.write_text(robot(BASE, BASE))
    with pytest.raises(ModelError, match=r"arm\.urdf: two links.*line 3 and line 2"):
        load(path)


def test_a_missing_file_is_answered_with_similar_names(tmp_path):
    (tmp_path / "panda_arm.urdf").write_text(robot(BASE))
    with pytest.raises(NotFoundError, match=r"'.*pandaarm\.urdf'.*panda_arm\.urdf"):
        load(tmp_path / "pandaarm.urdf")
    with pytest.raises(FileNotFoundError, match="folder"):
        load(tmp_path / "nowhere" / "robot.urdf")


def test_a_folder_is_answered_with_the_robot_files_in_it(tmp_path):
    (tmp_path / "arm.urdf").write_text(robot(BASE))
    with pytest.raises(RobotFileError, match=r"is a folder.*arm\.urdf"):
        load(str(tmp_path))


@pytest.mark.parametrize("nonsense", ["x" * 5000, "a\0b", 7, None, b"<robot/>"])
def test_what_is_neither_path_nor_text_is_refused(nonsense):
    with pytest.raises(TwistWrenchError):
        load(nonsense)


def test_files_too_large_are_refused_before_they_are_read(tmp_path, monkeypatch):
    monkeypatch.setattr(source, "MAX_BYTES", 2**20)
    path = tmp_path / "huge.urdf"
    with path.open("wb") as file:
        file.truncate(2**20 + 1)  # a hole: nothing is written
    with pytest.raises(RobotFileError, match=r"huge\.urdf.*more than 1 MiB"):
        load(path)
    with pytest.raises(RobotFileError, match="more than 1 MiB"):
        load("<" + " " * 2**20)


def test_bytes_that_are_no_text_are_refused_with_their_line(tmp_path):
    path = tmp_path / "latin.urdf"
    path.write_bytes(robot(BASE, "<!-- é -->").encode("latin-1"))
    with pytest.raises(RobotFileError, match=r"line 3.*utf-8.*UTF-8"):
        load(path)
    path.write_bytes(b'<?xml version="1.0" encoding="klingon"?>' + robot(BASE).encode())
    with pytest.raises(RobotFileError, match="'klingon'"):
        load(path)


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16", "latin-1"])
def test_text_is_read_in_its_encoding(tmp_path, encoding):
    declared = "utf-8" if encoding == "utf-8-sig" else encoding
    path = tmp_path / "robot.URDF"
    path.write_bytes(
        f'<?xml version="1.0" encoding="{declared}"?>\n<robot name="r"><link name="épaule"/></robot>'.encode(encoding)
    )
    assert list(load(path).frames) == ["épaule"]


def test_utf_16_of_either_order_of_bytes_is_known_by_its_mark(tmp_path):
    text = '<?xml version="1.0" encoding="utf-16"?>\n<robot name="r"><link name="épaule"/></robot>'
    for mark, encoding in ((b"\xff\xfe", "utf-16-le"), (b"\xfe\xff", "utf-16-be")):
        path = tmp_path / f"{encoding}.urdf"
        path.write_bytes(mark + text.encode(encoding))
        assert list(load(path).frames) == ["épaule"]


@pytest.mark.parametrize("before", ["\n\n", "\ufeff", "\r\n \t\n"])
def test_blanks_before_the_declaration_are_forgiven_and_counted(before):
    text = before + '<?xml version="1.0"?>\n' + robot(BASE, '<link name=""/>')
    line = text[: text.index('<link name=""')].count("\n") + 1
    with pytest.raises(RobotFileError, match=rf"line {line}\b"):
        load(text)


def test_a_path_and_its_text_load_the_same(tmp_path):
    path = tmp_path / "r.urdf"
    path.write_text(robot(BASE))
    assert load(path).name == load(str(path)).name == load(robot(BASE)).name == "r"
    assert load(path).source == str(path)
