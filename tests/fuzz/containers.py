"""Changes inside containers: zip archives, NumPy arrays, gzip, MAT files, MCAP files, bags of ROS 1, databases.

The content is taken apart, changed by another mutation, and put together again with right or wrong sizes.
"""

from __future__ import annotations

import bz2
import gzip
import io
import re
import sqlite3
import struct
import tempfile
import zipfile
import zlib
from collections.abc import Iterator
from contextlib import closing, suppress
from pathlib import Path

from .mutations import INTEGERS, WORDS, Dice, Mutation, flipped, lengths, place, tokens

# ── zip archives

_METHODS = (0, 8, 9, 12, 14, 93, 99)


def members(inner: Mutation, *, stored: bool = False) -> Mutation:
    """Members of a zip archive changed, renamed, repeated, removed, put in; sizes, methods and checksums overwritten."""

    def change(data: bytes, dice: Dice) -> bytes:
        try:
            with zipfile.ZipFile(io.BytesIO(data)) as archive:
                found = [(name, archive.read(name)) for name in archive.namelist()]
        except (zipfile.BadZipFile, zlib.error, ValueError, NotImplementedError, OSError, RuntimeError, EOFError):
            return flipped(data, dice)
        if not found:
            return flipped(data, dice)
        at, how = dice.randrange(len(found)), dice.randrange(10)
        name, content = found[at]
        if how <= 4:
            found[at] = name, inner(content, dice)
        elif how == 5:
            new = dice.choice(
                (dice.choice(found)[0], "../../x.npy", "/etc/x.npy", "n" * 3000 + ".npy", "\x1b[2J.npy", "x/", ".npy")
            )
            found[at] = new, content
        elif how == 6:
            found.append((name, dice.choice(found)[1]))
        elif how == 7:
            del found[at]
        elif how == 8:
            found.insert(
                0, (dice.choice(("x.npy", "a.usda", "said.npy")), dice.choice((content, b"", inner(content, dice))))
            )
        out = io.BytesIO()
        method = zipfile.ZIP_STORED if stored or dice.often(0.3) else zipfile.ZIP_DEFLATED
        with zipfile.ZipFile(out, "w", method) as archive:
            for name, content in found:
                with suppress(UnicodeEncodeError):  # halves of surrogates
                    _put(archive, name, content)
        data = out.getvalue()
        return _overwritten(data, dice) if how == 9 or dice.often(0.1) else data

    return change


def _put(archive: zipfile.ZipFile, name: str, content: bytes) -> None:
    import warnings

    with warnings.catch_warnings():  # of a name that is there already
        warnings.simplefilter("ignore")
        undated = zipfile.ZipInfo(name)  # a seed gives the same file at any hour
        archive.writestr(undated, content, archive.compression)


def _overwritten(data: bytes, dice: Dice) -> bytes:
    """A field of a local or central header overwritten: method, flags, checksum, sizes, offset."""
    mark, fields = dice.choice(
        ((b"PK\x03\x04", {6: "H", 8: "H", 14: "I", 18: "I", 22: "I", 26: "H"}), (b"PK\x01\x02", {8: "H", 10: "H", 16: "I", 20: "I", 24: "I", 42: "I"}), (b"PK\x05\x06", {8: "H", 10: "H", 12: "I", 16: "I"}))
    )  # fmt: skip
    places = [found.start() for found in re.finditer(re.escape(mark), data)]
    if not places:
        return flipped(data, dice)
    offset = dice.choice(sorted(fields))
    at, form = dice.choice(places) + offset, "<" + fields[offset]
    value = dice.choice((*_METHODS, *INTEGERS)) % (1 << 8 * struct.calcsize(form))
    return data[:at] + struct.pack(form, value) + data[at + struct.calcsize(form) :]


# ── Arrays in NumPy's format

_SHAPES = (
    "()", "(0,)", "(-1,)", "(1,)", "(3,)", "(50,)", "(50, 2)", "(2, 50)", "(50, 0)", "(0, 5)", "(2, 134217728)", "(134217728, 2)", "(1000000000000,)",
    "(2, 3, 4)", "(50, 1, 2)", "(True,)", "(1.5,)", "('x',)", "None", "[50]", "(9223372036854775807, 9)", "(50L,)", "((50,),)", "(50, 16777216)", "(" * 900,
)  # fmt: skip
_LARGE = (
    "(2, 134217728)",
    "(134217728, 2)",
    "(40, 3000000)",
    "(1, 2000000000)",
    "(1000000000000,)",
    "(9223372036854775807, 9)",
)
_TYPES = (
    "'|O'", "'<f8'", "'>f8'", "'<f4'", "'<f2'", "'<c16'", "'|b1'", "'|i1'", "'<u8'", "'<U8'", "'|S9'", "'<M8[ns]'", "'<m8[s]'", "'<M8'", "'|V8'", "'<V2147483647'",
    "'<U536870911'", "[('a', '<f8'), ('b', '<f8')]", "[('\\x1b[2J', '<f8')]", "[('a', '<f8', (1000000,))]", "[('a', '|O')]", "[('a', [('b', '<f8')])]", "[]", "'<f99'", "None", "'|V0'", "('<f8', (3,))",
)  # fmt: skip


def array(data: bytes, dice: Dice) -> bytes:
    """Shape, type or order in the header of an array replaced, or its numbers changed or cut."""
    if data[:6] != b"\x93NUMPY" or len(data) < 12:
        return flipped(data, dice)
    size = struct.unpack_from("<H", data, 8)[0]
    head, body = data[10 : 10 + size].decode("latin-1"), data[10 + size :]
    how = dice.randrange(8)
    if how <= 2:
        shape = dice.choice(_LARGE if dice.often(0.4) else _SHAPES)
        head = re.sub(r"'shape': .*?\)(?=, })", lambda _: f"'shape': {shape}", head)
    elif how <= 4:
        head = re.sub(r"'descr': .*?(?=, 'fortran)", lambda _: f"'descr': {dice.choice(_TYPES)}", head)
    elif how == 5:
        head = head.replace("False", dice.choice(("True", "1", "None", "'x'")))
    elif how == 6:
        head = tokens(head.encode("latin-1"), dice).decode("latin-1")
    else:
        body = dice.choice((body[: len(body) // 2], body * 2, b"", flipped(body, dice), lengths(body, dice)))
    new = head.rstrip(" \n").ljust(117).encode("latin-1", "replace")[:60_000] + b"\n"
    version = b"\x01\x00" if dice.often(0.85) else dice.choice((b"\x02\x00", b"\x03\x00", b"\x09\x00"))
    return data[:6] + version + struct.pack("<H" if version[0] == 1 else "<I", len(new)) + new + body


# ── gzip


def gzipped(inner: Mutation) -> Mutation:
    """Packed again after a change inside; the trailer overwritten, members repeated, or packed twice."""

    def change(data: bytes, dice: Dice) -> bytes:
        try:
            text = gzip.decompress(data)
        except (OSError, EOFError, zlib.error):
            return flipped(data, dice)
        how = dice.randrange(8)
        packed = gzip.compress(inner(text, dice) if how <= 4 else text, 6, mtime=0)
        if how == 5:
            return packed[:-8] + struct.pack("<II", dice.choice(INTEGERS) % 2**32, dice.choice(INTEGERS) % 2**32)
        if how == 6:
            return packed * dice.choice((2, 20)) + dice.choice((b"", b"junk"))
        return gzip.compress(packed, mtime=0) if how == 7 and dice.often(0.3) else packed

    return change


# ── MAT files of version 5


def matrices(data: bytes, dice: Dice) -> bytes:
    """An element of a MAT file changed, unpacked or not, with its right size or another."""
    if len(data) < 136 or data[126:128] != b"IM":
        return lengths(data, dice)
    parts, at = [], 128
    while at + 8 <= len(data):
        kind, size = struct.unpack_from("<II", data, at)
        parts.append((kind, data[at + 8 : at + 8 + size]))
        at += 8 + size
    k = dice.randrange(len(parts))
    kind, content = parts[k]
    if kind == 15:
        with suppress(zlib.error):
            content = zlib.decompress(content)[8:]
    content = dice.choice((flipped, lengths, lengths))(content, dice)
    size = len(content) if dice.often(0.7) else dice.choice(INTEGERS) % 2**32
    whole = struct.pack("<II", 14, size) + content
    if dice.often(0.6):
        content, kind = zlib.compress(whole), 15
        parts[k] = kind, content
    else:
        parts[k] = 14, content
    if dice.often(0.1):
        parts.append(parts[k])
    return data[:128] + b"".join(struct.pack("<II", kind, len(content)) + content for kind, content in parts)


# ── MCAP files

_MCAP = b"\x89MCAP0\r\n"


def _mcap_records(data: bytes) -> Iterator[tuple[int, bytes]]:
    at = 0
    while at + 9 <= len(data):
        op, size = struct.unpack_from("<BQ", data, at)
        if size > len(data) - at - 9:
            return
        yield op, data[at + 9 : at + 9 + size]
        at += 9 + size


def _mcap_joined(records: list[tuple[int, bytes]]) -> bytes:
    return b"".join(struct.pack("<BQ", op, len(content)) + content for op, content in records)


def mcap(data: bytes, dice: Dice) -> bytes:
    """A record of an MCAP file changed, in chunks or outside, with chunks packed again and the summary kept or dropped."""
    records = list(_mcap_records(data[8:-8]))
    if data[:8] != _MCAP or not records:
        return flipped(data, dice)
    if dice.often(0.4):  # without the summary all messages are looked through
        ends = [k for k, (op, _) in enumerate(records) if op == 15]
        records = [*records[: ends[0] + 1], (2, struct.pack("<QQI", 0, 0, 0))] if ends else records
    _records_changed(records, dice)
    return _MCAP + _mcap_joined(records) + _MCAP


def _records_changed(records: list[tuple[int, bytes]], dice: Dice) -> None:
    k = dice.randrange(len(records))
    chunks = [i for i, (op, _) in enumerate(records) if op == 6]
    if chunks and dice.often(0.6):
        k = dice.choice(chunks)
    op, content = records[k]
    how = dice.randrange(8)
    if op == 6 and how <= 5:
        records[k] = op, _chunk(content, dice)
    elif how <= 4:
        records[k] = op, dice.choice((flipped, lengths, lengths, tokens))(content, dice)
    elif how == 5:
        records.insert(dice.randrange(len(records)), (op, content))
    elif how == 6:
        del records[k]
    else:
        records[k] = dice.choice((0, 3, 4, 5, 7, 15, 200, op)), content


def _chunk(content: bytes, dice: Dice) -> bytes:
    """The records of a chunk changed and packed again; the size once unpacked is right, huge or too small."""
    import lz4.frame
    import zstandard

    head = struct.calcsize("<QQQII")
    if len(content) < head:  # shortened by an earlier change
        return flipped(content, dice)
    begin, end, _, _, letters = struct.unpack_from("<QQQII", content)
    compression = content[32 : 32 + letters].decode("ascii", "replace")
    raw = content[32 + letters + 8 :]
    try:
        raw = {
            "zstd": lambda: zstandard.ZstdDecompressor().decompress(raw, 1 << 24),
            "lz4": lambda: lz4.frame.decompress(raw),
            "": lambda: raw,
        }[compression]()
    except (KeyError, RuntimeError, zstandard.ZstdError):
        return flipped(content, dice)
    inner = list(_mcap_records(raw))
    if inner:
        _records_changed(inner, dice)
    raw = _mcap_joined(inner)
    if dice.often(0.1):
        raw += bytes(dice.choice((1000, 100_000_000)))
    said = len(raw) if dice.often(0.8) else dice.choice(INTEGERS)
    name = dice.choice(("", "lz4", "zstd", compression))
    packed = {"": lambda: raw, "lz4": lambda: lz4.frame.compress(raw), "zstd": lambda: zstandard.compress(raw)}[name]()
    label = name if dice.often(0.95) else dice.choice(("brotli", "zstd", "lz4", ""))
    head = struct.pack("<QQQII", begin, end, said % 2**64, 0, len(label)) + label.encode()
    return head + struct.pack("<Q", len(packed)) + packed


# ── Bags of ROS 1


def bag(data: bytes, dice: Dice) -> bytes:
    """Header fields or data of a record of a bag changed; chunks unpacked and packed again."""
    line, _, rest = data.partition(b"\n")
    records, at = [], 0
    while at + 8 <= len(rest):
        (head,) = struct.unpack_from("<I", rest, at)
        if at + 8 + head > len(rest):
            break
        (size,) = struct.unpack_from("<I", rest, at + 4 + head)
        records.append((rest[at + 4 : at + 4 + head], rest[at + 8 + head : at + 8 + head + size]))
        at += 8 + head + size
    if not records:
        return flipped(data, dice)
    k = dice.randrange(len(records))
    head, body = records[k]
    how = dice.randrange(8)
    if how <= 2:
        head = dice.choice((flipped, lengths, tokens))(head, dice)
    elif how <= 4:
        body = dice.choice((flipped, lengths, tokens))(body, dice)
    elif how == 5 and b"compression=none" in head:
        head = head.replace(struct.pack("<I", 16) + b"compression=none", struct.pack("<I", 15) + b"compression=bz2")
        body = bz2.compress(flipped(body, dice))
    elif how == 6:
        records.insert(dice.randrange(len(records)), records[k])
    else:
        body = b""
    records[k] = head, body
    return line + b"\n" + b"".join(struct.pack("<I", len(h)) + h + struct.pack("<I", len(b)) + b for h, b in records)


# ── Databases

STATEMENTS = (
    "drop table TABLE", "alter table TABLE rename to x", "alter table TABLE rename column COLUMN to x", "delete from TABLE", "update TABLE set COLUMN = null",
    "update TABLE set COLUMN = zeroblob(1000000)", "update TABLE set COLUMN = cast(COLUMN as text)", "update TABLE set COLUMN = 'x\x1b[2J'", "update TABLE set COLUMN = -1",
    "update TABLE set COLUMN = 1e308", "update TABLE set COLUMN = 9223372036854775807", "update TABLE set COLUMN = x'ff00'", "insert into TABLE select * from TABLE",
    "drop table TABLE; create view TABLE(id, topic_id, timestamp, data) as with recursive r(n) as (select 1 union all select n+1 from r) select n, 1, n, zeroblob(1000) from r",
    "drop table TABLE; create view TABLE(id, name, type, serialization_format) as with recursive r(n) as (select 1 union all select n+1 from r) select n, 'a' || n, 'x', 'cdr' from r",
    "drop table TABLE; create view TABLE as select 1 as id, load_extension('/tmp/x') as name, 'x' as type",
    "drop table TABLE; create table TABLE(id, topic_id, timestamp, data, name, type, serialization_format, g generated always as (id/0))",
    "drop table TABLE; create virtual table TABLE using fts5(id, topic_id, timestamp, data)",
    "create index i on TABLE(abs(COLUMN))", "create trigger t after insert on TABLE begin delete from TABLE; end", "pragma user_version = -1", "pragma journal_mode = wal",
    "pragma writable_schema = on; update sqlite_master set sql = 'create table x(' where name = 'TABLE'",
    "pragma writable_schema = on; update sqlite_master set rootpage = 1 where name = 'TABLE'",
    "pragma writable_schema = on; update sqlite_master set rootpage = 900000 where name = 'TABLE'",
    "create table message_definitions(topic_type, encoding, encoded_message_definition); insert into message_definitions values('sensor_msgs/msg/JointState', 'ros2msg', 'int32[')",
    "update message_definitions set encoded_message_definition = 'sensor_msgs/JointState x'",
    "update message_definitions set encoded_message_definition = replace(encoded_message_definition, 'float64', 'float64[1000000000]')",
    "attach ':memory:' as x",
)  # fmt: skip


def database(data: bytes, dice: Dice) -> bytes:
    """A statement of SQL run on the database: tables become views without end, cells blobs, the schema wrong."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, "x.db3")
        path.write_bytes(data)
        damaged = sqlite3.Error, sqlite3.Warning, UnicodeDecodeError  # the last of messages that quote a damaged name
        with closing(sqlite3.connect(path)) as opened, suppress(*damaged):
            names = [str(name) for (name,) in opened.execute("select name from sqlite_master where type = 'table'")]
            table = dice.choice(["messages", "topics", *names])
            columns = [str(row[1]) for row in opened.execute(f"pragma table_info({table})")] or ["id"]
            statement = dice.choice(STATEMENTS).replace("TABLE", table).replace("COLUMN", dice.choice(columns))
            opened.executescript(statement)
            opened.commit()
        return path.read_bytes()


def named_places(*endings: str) -> Mutation:
    """A text in quotes replaced by the name of a file that may not be reached."""

    def change(data: bytes, dice: Dice) -> bytes:
        quoted = list(re.finditer(rb"""(["'@])[^"'@\n]*\1""", data))
        if not quoted:
            return tokens(data, dice)
        found = dice.choice(quoted)
        new = place(dice, *endings) if dice.often(0.7) else dice.choice(WORDS)
        return data[: found.start() + 1] + new + data[found.end() - 1 :]

    return change
