"""What can go wrong with a file: each mutator takes the bytes of a good one and returns those of a spoilt one."""

from __future__ import annotations

import random
import re
from collections.abc import Callable

Mutator = Callable[[bytes, random.Random], bytes]

NUMBERS = (
    "inf", "-inf", "nan", "1e308", "-1e308", "1e999", "1e-320", "0", "-0.0", "-1", "1e15", "9223372036854775808",
    "1" + "0" * 400, "1" * 5000, "0x10", "1_000", "+5", "1,5", "12:30:00", "1979-05-27", "1979-05-27T07:32:00Z",
    "true", '"text"', "''", "[]", "{}", "[[1, 2], [3]]", "{ value = 1, sd = -1 }", "{ value = inf }", "--", "",
)  # fmt: skip
TEXTS = (
    "", " ", ".", "..", "/", "../up.csv", "/dev/zero", "/dev/null", "/etc", "a\\u0000b", "two\\nlines", "\\u001b[31m",
    "x" * 300, "x" * 3000, "<script>alert(1)</script>", "[bold]", "{0}", "%s", "\\u202e", "ünï", "nan", "self_heating",
    "ocv_hysteresis", "paper", "samsung_30q", "cell", "motor", "robot", "voltage_V", "current_A", "kind",
)  # fmt: skip
_NUMBER = re.compile(r"(?<![\w.])[-+]?\d+\.?\d*(?:e[-+]?\d+)?(?![\w.])")
_TEXT = re.compile(r'"[^"\n]*"')
_NAME = re.compile(r"[A-Za-z_][\w./<>-]{2,}")


def _of_text(change: Callable[[str, random.Random], str]) -> Mutator:
    """Return the mutator of a file's bytes that changes its text."""

    def mutator(content: bytes, rng: random.Random) -> bytes:
        return change(content.decode("utf-8", errors="surrogateescape"), rng).encode("utf-8", errors="surrogateescape")

    return mutator


def _exchanged(text: str, pattern: re.Pattern[str], new: str, rng: random.Random) -> str:
    found = list(pattern.finditer(text))
    if not found:
        return text + new
    # The first lines of a file are names and settings; rows of a table are many, and each like the other.
    one = rng.choice(found[:60]) if rng.random() < 0.7 else rng.choice(found)
    return text[: one.start()] + new + text[one.end() :]


def number(text: str, rng: random.Random) -> str:
    """Write something else in place of a number."""
    return _exchanged(text, _NUMBER, rng.choice(NUMBERS), rng)


def quoted(text: str, rng: random.Random) -> str:
    """Write something else in place of a text in quotes."""
    new = rng.choice(TEXTS)
    return _exchanged(text, _TEXT, f'"{new}"' if rng.random() < 0.9 else rng.choice(NUMBERS), rng)


def name(text: str, rng: random.Random) -> str:
    """Write another name of the same file, or one misspelt, in place of a name."""
    names = _NAME.findall(text[:20_000]) or ["name"]
    chosen = rng.choice(names)
    misspelt = (
        chosen[:-1],
        chosen + "s",
        chosen.upper(),
        chosen.replace("_", " "),
        f"{chosen}.{chosen}",
        f'"{chosen}"',
    )
    return _exchanged(text, _NAME, rng.choice([chosen, *misspelt, rng.choice(TEXTS)]), rng)


def lines(text: str, rng: random.Random) -> str:
    """Drop, repeat, move or cut a line."""
    all_lines = text.splitlines(keepends=True) or [""]
    at, to = rng.randrange(min(len(all_lines), 60)), rng.randrange(len(all_lines))
    line = all_lines[at]
    match rng.randrange(5):
        case 0:
            del all_lines[at]
        case 1:
            all_lines.insert(to, line)
        case 2:
            all_lines.insert(to, all_lines.pop(at))
        case 3:
            all_lines[at] = line[: rng.randrange(len(line) + 1)]
        case _:
            all_lines[at] = "\n" * rng.randrange(3)
    return "".join(all_lines)


def fields(text: str, rng: random.Random) -> str:
    """Add, drop or spoil a field of a row."""
    all_lines = text.splitlines() or [""]
    at = rng.randrange(len(all_lines)) if rng.random() < 0.6 else rng.randrange(min(len(all_lines), 3))
    mark = next((mark for mark in ("\t", ";", ",") if mark in all_lines[at]), ",")
    row = all_lines[at].split(mark)
    place = rng.randrange(len(row))
    match rng.randrange(4):
        case 0:
            del row[place]
        case 1:
            row.insert(place, rng.choice(NUMBERS))
        case 2:
            row[place] = rng.choice(NUMBERS + TEXTS)
        case _:
            row[place] = f'"{row[place]}'
    all_lines[at] = mark.join(row)
    return "\n".join(all_lines) + "\n"


def deep(text: str, rng: random.Random) -> str:
    """Nest something deeper than anyone would."""
    depth = rng.choice((20, 200, 3000, 60_000))
    nests = (
        "deep = " + "[" * depth + "]" * depth,
        "deep = " + "{ a = " * depth + "1" + " }" * depth,
        ".".join("a" * (depth // 10 + 2)) + " = 1",
        "[" + ".".join("a" * (depth // 10 + 2)) + "]\nx = 1",
        "[" * depth,
        '{"a":' * depth,
    )
    nest = rng.choice(nests)
    return f"{nest}\n{text}" if rng.random() < 0.5 else f"{text}\n{nest}\n"


def data(content: bytes, rng: random.Random) -> bytes:
    """Flip, drop, repeat or insert bytes, or cut the end off."""
    if not content:
        return rng.randbytes(20)
    at, size = rng.randrange(len(content)), rng.choice((1, 1, 2, 8, 100))
    match rng.randrange(5):
        case 0:
            return content[:at] + bytes([content[at] ^ 1 << rng.randrange(8)]) + content[at + 1 :]
        case 1:
            return content[:at] + content[at + size :]
        case 2:
            return content[:at] + content[at : at + size] + content[at:]
        case 3:
            return content[:at] + rng.choice((b"\0", b"\xff", b"\r", b'"', rng.randbytes(size))) + content[at:]
        case _:
            return content[:at]


def coded(content: bytes, rng: random.Random) -> bytes:
    """Write the same text in another encoding, or with other ends of lines."""
    text = content.decode("utf-8", errors="replace")
    match rng.randrange(5):
        case 0:
            return text.encode("utf-16")
        case 1:
            return b"\xef\xbb\xbf" + content
        case 2:
            return text.replace("\n", "\r").encode("utf-8")
        case 3:
            return text.replace("\n", "\r\n").encode("utf-8")
        case _:
            return text.encode("latin-1", errors="replace") + b"\xb0"


TEXT: tuple[Mutator, ...] = (
    *map(_of_text, (number, number, number, quoted, quoted, name, name, lines, lines, fields, deep)), data, coded,
)  # fmt: skip
TABLE: tuple[Mutator, ...] = (*map(_of_text, (fields, fields, fields, number, name, lines, quoted)), data, coded)
BINARY: tuple[Mutator, ...] = (data,)


def spoilt(content: bytes, mutators: tuple[Mutator, ...], rng: random.Random) -> bytes:
    """Return a file's bytes after one to three mutators."""
    for _ in range(rng.choice((1, 1, 1, 2, 3))):
        content = rng.choice(mutators)(content, rng)
    return content
