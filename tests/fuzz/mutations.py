"""Changes of bytes and texts: flips, lengths, tokens, numbers, lines, XML elements, values of JSON and YAML, cells."""

from __future__ import annotations

import codecs
import copy
import json
import random
import re
import struct
import xml.etree.ElementTree as ET
from collections.abc import Callable
from typing import Any


class Dice(random.Random):
    """Random choices of one file, and the places that its text may name."""

    def __init__(self, seed: str, outside: str = "/nonexistent", own: str = "file") -> None:
        super().__init__(seed)
        self.outside = outside
        """Folder that no reader may look into."""
        self.own = own
        """Name of the file itself."""

    def often(self, share: float) -> bool:
        return self.random() < share


Mutation = Callable[[bytes, Dice], bytes]

NUMBERS = (
    b"nan", b"-nan", b"inf", b"-inf", b"1e308", b"-1e308", b"1e999", b"1e-400", b"-0", b"0", b"-1", b"1e-300", b"3", b"1000000000",
    b"9" * 5000, b"1" + b"0" * 400, b"4294967295", b"4294967296", b"9223372036854775807", b"18446744073709551616", b"-9223372036854775809",
    b"0x10", b"1_0", b"1,5", b"1.5.2", b"1e", b"+", b"", b"true", b"null", "１２".encode(), b"0." + b"3" * 1000, b"1e5e5", b"2 2", b"1/0",
)  # fmt: skip
WORDS = (
    b"\x00", b"\xff", b"\x1b[31m", b"\x07", b"\x7f", b"\xc2\x85", b"\xed\xa0\x80", "\u2028".encode(), "\u202e".encode(), b"\\ud800",
    b"&#27;[2J", b"&#10;&#10;", b"&lt;", b"&", b"n" * 300, b"n" * 70_000, ("é" * 400).encode(), b"[", b"{", b"]", b"}", b"<", b">", b'"',
    b"'", b",", b";", b":", b"%s%n", b"{0.__class__}", b"\t", b"\r", b"\n", b"\n\n", b"null", b"true", b"[]", b"{}", b"&a [*a]", b"*a",
    b"!!int x", b"!!python/object/apply:os.system [id]", b"<!--", b"]]>", b"${1/0}", b"$(env HOME)", b"-", b"#", b"world", b"base", b"",
)  # fmt: skip
INTEGERS = (0, 1, 2, 3, 7, 8, 127, 128, 255, 256, 4096, 32767, 65535, 65536, 10**6, 2**24, 2**27, 2**31 - 1, 2**31, 2**32 - 1, 2**32, 2**40, 2**62, 2**63 - 1, 2**63, 2**64 - 1)  # fmt: skip

WORD = re.compile(rb"[-+.\w/]+")
NUMBER = re.compile(rb"[-+]?\d[\d.eE+-]*")


def text_of(data: bytes) -> str:
    """The bytes as text, halves of surrogates among it; as Latin-1 if they are not UTF-8."""
    try:
        return data.decode("utf-8", "surrogatepass")
    except UnicodeDecodeError:
        return data.decode("latin-1")


def place(dice: Dice, *endings: str) -> bytes:
    """Name of a file that a file may not reach, does not exist, or is itself."""
    ending = dice.choice(endings or (".stl", ".xml", ".usda", ".h5", ".csv"))
    secret = f"{dice.outside}/secret{ending}"
    if dice.often(0.6):  # a file that is there, in one of the ways to name it
        back = "../" * 12 + secret.lstrip("/")
        return dice.choice((secret, f"file://{secret}", back, f"{dice.outside}/pipe{ending}")).encode()
    names = (
        secret, f"file://{secret}", f"file://localhost{secret}", "../" * 12 + secret.lstrip("/"), f"package://..{secret}", f"package://x/../../../..{secret}",
        f"model://a/../..{secret}", f"{dice.outside}/pipe{ending}", f"http://127.0.0.1:9/x{ending}", "/dev/zero", "/etc/passwd",
        f"missing{ending}", dice.own, f"./{dice.own}", ".", "", f"{'d/' * 2000}x{ending}", f"a\x00{ending}",
    )  # fmt: skip
    return dice.choice(names).encode()


# ── Bytes


def flipped(data: bytes, dice: Dice) -> bytes:
    """One to three bytes changed, cut, doubled or put in."""
    for _ in range(dice.choice((1, 1, 1, 2, 3))):
        at = dice.randrange(len(data) + 1)
        to = min(len(data), at + dice.choice((1, 4, 30, 400)))
        how = dice.randrange(6)
        if how == 0 and at < len(data):
            data = data[:at] + bytes([dice.randrange(256)]) + data[at + 1 :]
        elif how == 1 and at < len(data):
            data = data[:at] + bytes([data[at] ^ 1 << dice.randrange(8)]) + data[at + 1 :]
        elif how == 2:
            data = data[:at] + data[to:]
        elif how == 3:
            data = data[:to] + data[at:]
        elif how == 4:
            data = data[:at] + dice.choice(WORDS) + data[at:]
        else:
            data = data[:at] + dice.randbytes(to - at) + data[to:]
    return data


def cut(data: bytes, dice: Dice) -> bytes:
    """Beginning of the data, or the data and more behind."""
    if dice.often(0.7):
        return data[: dice.randrange(len(data) + 1)]
    return data + dice.choice((data, data[:100], b"\0" * 5000, dice.randbytes(50)))


def lengths(data: bytes, dice: Dice) -> bytes:
    """A number that looks like a length or an offset in the data, replaced by another."""
    order = dice.choice("<<<>")
    form = dice.choice("HIIIQQ")
    size = struct.calcsize(form)
    if len(data) < size:
        return flipped(data, dice)
    at = dice.randrange(len(data) - size + 1)
    for _ in range(60):  # one that fits into the file, if there is one near
        tried = dice.randrange(len(data) - size + 1)
        if 0 < struct.unpack_from(order + form, data, tried)[0] <= max(64, len(data)):
            at = tried
            break
    now = struct.unpack_from(order + form, data, at)[0]
    new = dice.choice((*INTEGERS, now + 1, now - 1, 2 * now, now << 16, len(data), len(data) - at))
    return data[:at] + struct.pack(order + form, new % (1 << 8 * size)) + data[at + size :]


# ── Text


def tokens(data: bytes, dice: Dice) -> bytes:
    """A word replaced by junk, by a place, or by another word of the text."""
    found = list(WORD.finditer(data))
    if not found:
        return flipped(data, dice)
    word = dice.choice(found)
    new = dice.choice((dice.choice(WORDS), dice.choice(found)[0], dice.choice(found)[0], place(dice), word[0] * 2))
    return data[: word.start()] + new + data[word.end() :]


def numbers(data: bytes, dice: Dice) -> bytes:
    """A number replaced by a value at the ends of what can be written."""
    found = list(NUMBER.finditer(data))
    if not found:
        return tokens(data, dice)
    word = dice.choice(found)
    new = dice.choice((*NUMBERS, dice.choice(found)[0], b"-" + word[0]))
    return data[: word.start()] + new + data[word.end() :]


def lines(data: bytes, dice: Dice) -> bytes:
    """Lines doubled, removed, exchanged, joined, or many times over."""
    rows = data.split(b"\n")
    a, b = dice.randrange(len(rows)), dice.randrange(len(rows))
    how = dice.randrange(6)
    if how == 0:
        rows.insert(b, rows[a])
    elif how == 1:
        del rows[a : a + dice.choice((1, 1, 3, 10))]
    elif how == 2:
        rows[a], rows[b] = rows[b], rows[a]
    elif how == 3:
        rows[a : a + 2] = [b"".join(rows[a : a + 2])]
    elif how == 4:
        rows[a:a] = [rows[a]] * dice.choice((20, 2000))
    else:
        rows[a] = b" " * dice.choice((1, 7)) + rows[a]
    return b"\n".join(rows)


def encoded(data: bytes, dice: Dice) -> bytes:
    """The text in another encoding, with another byte order mark, or with other ends of lines."""
    text = data.decode("utf-8", "replace")
    how = dice.randrange(6)
    if how < 3:
        coding = dice.choice(("utf-16", "utf-16-le", "utf-16-be", "utf-32", "latin-1", "utf-7"))
        return text.encode(coding, "replace")
    if how == 3:
        return dice.choice((codecs.BOM_UTF8, codecs.BOM_UTF16_LE, codecs.BOM_UTF32_BE)) + data
    return data.replace(b"\n", dice.choice((b"\r", b"\r\n", b"\n\n", b"\x0b", b"\x85", "\u2028".encode())))


# ── XML

ET.register_namespace("xacro", "http://www.ros.org/wiki/xacro")
_ENTITIES = (
    b'<!DOCTYPE r [<!ENTITY a "aaaa"><!ENTITY b "&a;&a;&a;">]>',
    b'<!DOCTYPE r [<!ENTITY a SYSTEM "file:///etc/passwd">]>',
    b'<!DOCTYPE r SYSTEM "http://127.0.0.1:9/x.dtd">',
    b'<?xml version="1.0" encoding="utf-16"?>',
    b'<?xml version="1.1"?>',
    b'<?xml-stylesheet href="x"?>',
)


def _value(dice: Dice, values: list[str]) -> str:
    how = dice.randrange(4)
    if how == 0:
        return dice.choice(NUMBERS).decode()
    if how == 1:
        return text_of(dice.choice(WORDS))
    if how == 2 and values:
        return dice.choice(values)
    return " ".join(dice.choice(NUMBERS).decode() for _ in range(dice.choice((1, 3, 4, 6))))


def elements_with(vocabulary: tuple[str, ...], *endings: str) -> Mutation:
    """Change of an XML file that takes further elements from the vocabulary; ``PLACE`` in them is a name of a file."""

    def elements(data: bytes, dice: Dice) -> bytes:
        try:
            root = ET.fromstring(data)
            if endings and dice.often(0.15):
                _renamed_file(root, dice, endings)
            for _ in range(dice.choice((1, 1, 2, 3))):
                _element_changed(root, dice, vocabulary, endings)
            text = ET.tostring(root, "unicode").encode("utf-8", "surrogatepass")
        except (ET.ParseError, ValueError, LookupError, RecursionError):  # changed before: no XML, or too deep
            return tokens(data, dice)
        if dice.often(0.04):
            text = dice.choice(_ENTITIES) + text
        if dice.often(0.04):
            tag = dice.choice((b"body", b"link", b"frame", b"model", b"a", b"default", b"xacro:if value='1'"))
            at = text.find(b">", dice.randrange(len(text))) + 1
            deep = dice.choice((40, 3000, 30_000))
            text = text[:at] + (b"<" + tag + b">") * deep + (b"</" + tag.split()[0] + b">") * deep + text[at:]
        return text

    return elements


_FILE = re.compile(r"\.[a-z]{3,6}$")
"""End of the name of a file."""


def _renamed_file(root: ET.Element, dice: Dice, endings: tuple[str, ...]) -> None:
    """Another name in the place of that of a mesh or an included file."""
    named = [(each, name) for each in root.iter() for name, value in each.attrib.items() if _FILE.search(value)]
    texts = [each for each in root.iter() if each.text and _FILE.search(each.text.strip())]
    new = place(dice, *endings).decode("utf-8", "replace")
    if named and (not texts or dice.often(0.5)):
        element, name = dice.choice(named)
        element.set(name, new)
    elif texts:
        dice.choice(texts).text = new


def _element_changed(root: ET.Element, dice: Dice, vocabulary: tuple[str, ...], endings: tuple[str, ...]) -> None:
    every = list(root.iter())
    inner = [(parent, child) for parent in every for child in parent]
    one = dice.choice(every)
    how = dice.randrange(12)
    if vocabulary and dice.often(0.15):
        how = 6
    if how <= 4:
        _attribute_changed(one if one.attrib else dice.choice(every), every, dice, endings)
    elif how == 5:
        values = [each.text for each in every if each.text and each.text.strip()]
        one.text = _value(dice, values)
    elif how == 6 and vocabulary:
        text = dice.choice(vocabulary).replace("PLACE", "P" * 9).replace("OUTSIDE", dice.outside)
        new = ET.fromstring(f'<x xmlns:xacro="http://www.ros.org/wiki/xacro">{text}</x>')[0]
        for each in new.iter():
            for name, value in each.attrib.items():
                each.set(name, value.replace("P" * 9, place(dice, *endings).decode("utf-8", "replace")))
            each.text = each.text and each.text.replace("P" * 9, place(dice, *endings).decode("utf-8", "replace"))
        dice.choice(every).insert(0, new)
    elif how == 7:
        one.tag = dice.choice(every).tag
    elif inner:
        parent, child = dice.choice(inner)
        copied = copy.deepcopy(child)
        if how == 8:
            parent.remove(child)
        elif how == 9:
            for _ in range(dice.choice((1, 1, 5, 200))):
                parent.append(copied)
        elif how == 10:
            dice.choice(every).append(copied)  # also into itself
        else:
            parent.remove(child)
            parent.insert(0, child)


def _attribute_changed(one: ET.Element, every: list[ET.Element], dice: Dice, endings: tuple[str, ...]) -> None:
    names = sorted({name for each in every for name in each.attrib})
    if not names:
        one.set(dice.choice(("name", "type", "value")), text_of(dice.choice(WORDS)))
        return
    name = dice.choice(sorted(one.attrib) or names)
    others = [each.attrib[name] for each in every if name in each.attrib]
    how = dice.randrange(8)
    if how <= 2:
        one.set(name, _value(dice, others))
    elif how == 3:
        one.set(name, dice.choice(others) if others else "x")  # a reference to something else, or to itself
    elif how == 4 and name in one.attrib:
        value = numbers(one.attrib[name].encode("utf-8", "surrogatepass"), dice)
        one.set(name, value.decode("utf-8", "replace"))
    elif how == 5:
        one.attrib.pop(name, None)
    elif how == 6 and endings:
        named = [n for n in names if n in ("file", "filename", "uri", "href", "mesh", "ns")]
        one.set(dice.choice(named or names), place(dice, *endings).decode("utf-8", "replace"))
    else:
        one.set(dice.choice(names), one.attrib.get(name, "1"))


# ── Values: JSON and YAML

VALUES: tuple[Any, ...] = (
    None, True, False, 0, -1, 1e308, float("nan"), float("inf"), 10**400, "", "x", "1", "\x1b[2J", "\ud800", "n" * 3000, [], [[]], [1],
    ["x"], {}, {"a": 1}, [None], [[1], [2, 3]], [0] * 5000, "1e999", "-0 N m", "101:0", "nan rad/s", -0.0,
)  # fmt: skip


def _places(value: Any, at: tuple[Any, ...] = ()) -> list[tuple[Any, ...]]:
    inner = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    return [at, *(p for key, v in inner for p in _places(v, (*at, key)))]


def changed_value(content: Any, dice: Dice) -> Any:
    """A value replaced, removed, doubled, exchanged for another or nested, or an entry renamed."""
    where = [at for at in _places(content) if at]
    if not where:
        return dice.choice(VALUES)
    content = json.loads(json.dumps(content))

    def found(at: tuple[Any, ...]) -> Any:
        inner = content
        for key in at:
            inner = inner[key]
        return inner

    at = dice.choice(where)
    inner, key, how = found(at[:-1]), at[-1], dice.randrange(7)
    if how <= 2:
        inner[key] = dice.choice(VALUES)
    elif how == 3:
        del inner[key]
    elif how == 4:
        inner[key] = json.loads(json.dumps(found(dice.choice(where))))
    elif how == 5 and isinstance(inner, dict):
        name = dice.choice((dice.choice(where)[-1], "\x1b[2J", "n" * 3000, "", "\ud800", "ratio", "1"))
        inner[str(name)] = inner.pop(key)
    else:
        for _ in range(dice.choice((1, 60, 600))):
            inner[key] = [inner[key]] if dice.often(0.5) else {"a": inner[key]}
    return content


def json_values(data: bytes, dice: Dice) -> bytes:
    try:
        content = json.loads(data)
        for _ in range(dice.choice((1, 1, 2))):
            content = changed_value(content, dice)
        return json.dumps(content, ensure_ascii=dice.often(0.8)).encode("utf-8", "surrogatepass")
    except (ValueError, RecursionError):  # changed before, and deep
        return tokens(data, dice)


def yaml_values(data: bytes, dice: Dice) -> bytes:
    import yaml

    try:
        content = changed_value(yaml.load(data, yaml.BaseLoader), dice)
        return yaml.dump(content, allow_unicode=True, sort_keys=False).encode("utf-8", "surrogatepass")
    except (yaml.YAMLError, ValueError, RecursionError):
        return tokens(data, dice)


def yaml_text(data: bytes, dice: Dice) -> bytes:
    """Anchors, merges, tags, tabs, deep flow collections."""
    rows = data.split(b"\n")
    at = dice.randrange(len(rows))
    new = dice.choice(
        (b"a: &a [*a, *a]", b"<<: *x", b"? [a]", b"!!set {a, b}", b"\ta: 1", b"- " * 400, b"[" * 3000, b"{a: " * 600, b"--- a", b"...", b"%YAML 9.9", b"a: |\n x", b'"\\x1b[2J": 1', b"motors:", b"actuators: ~", b"b: &b\n  c: *b")
    )  # fmt: skip
    rows.insert(at, new)
    return b"\n".join(rows)


# ── Tables of text


def cells(data: bytes, dice: Dice) -> bytes:
    """Cells, rows and columns of a table changed, doubled or removed; delimiter, decimal mark or quotes replaced."""
    mark = b"\t" if b"\t" in data.split(b"\n")[0] else b";" if b";" in data.split(b"\n")[0] else b","
    rows = [row.split(mark) for row in data.rstrip(b"\n").split(b"\n")]
    at = dice.randrange(len(rows))
    column = dice.randrange(max(1, len(rows[at])))
    how = dice.randrange(13)
    if how <= 1:
        rows[at][column : column + 1] = [dice.choice(NUMBERS)]
    elif how == 2:
        rows[0][dice.randrange(len(rows[0]))] = dice.choice((*WORDS, *rows[0], b'"' + dice.choice(WORDS) + b'"'))
    elif how == 3:
        rows[at].insert(column, dice.choice((b"", b"1", b"x")))
    elif how == 4:
        del rows[at][column]
    elif how == 5:
        for row in rows:
            row.insert(min(column, len(row)), row[-1] if row else b"")
    elif how == 6:
        for row in rows:
            del row[column : column + 1]
    elif how == 7:
        rows[at:at] = [rows[at]] * dice.choice((1, 3, 3000))
    elif how == 8:
        rows[1:] = rows[:0:-1]
    elif how == 9:
        del rows[dice.choice((0, at))]
    elif how == 10:
        rows.insert(at, [dice.choice((b"", b"# comment", b"sep=;", b'"open', b"units,rad", b"\x00"))])
    elif how == 11:
        mark = dice.choice((b";", b"\t", b" ", b"|", b", ", b",,"))
        if dice.often(0.5):
            rows = [[cell.replace(b".", b",") for cell in row] for row in rows]
    else:
        rows = [[b'"' + cell + b'"' for cell in row] for row in rows]
    if dice.often(0.05):
        rows = [row * dice.choice((50, 3000)) for row in rows[:3]]
    return mark.join(rows[0]) + b"\n" + b"\n".join(mark.join(row) for row in rows[1:]) + b"\n" if rows else b""
