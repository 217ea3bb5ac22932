# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Damage files as disks, networks, editors and attackers do; the same number, the same damage."""

from __future__ import annotations

import re

import numpy as np
from numpy.random import Generator

WORDS = (
    b"nan", b"-nan", b"inf", b"-inf", b".nan", b".inf", b"1e308", b"-1e308", b"1e-300", b"1e256",
    b"0", b"-0", b"-1", b"1e9", b"9" * 30, b"9" * 5000, b"", b"null", b"true", b"[]", b"{}", b"~",
    b"0x", b"1.", b".", b"'", b'"', b"%", b"x", b"\xff\xfe", b"\0", b"../..", b"/dev/zero", b"*a",
    b"&a [*a]", b"!!python/name:os.system", b"[" * 200, b"{a: " * 200, b"- " * 200, b"2001-99-99",
    b"$\\frac{$", b"<script>", b"1,2,3", b"#", b":", b"\n", b"\n\n", b"\t",
)  # fmt: skip
"""Words that stand where readers expect numbers, names and structure."""
NUMBERS = (
    0,
    1,
    0x7F,
    0x80,
    0xFF,
    0x7FFF,
    0xFFFF,
    2**31 - 1,
    2**31,
    2**32 - 1,
    2**63 - 1,
    2**64 - 1,
)
_WORD = re.compile(rb"[^\s,:\[\]{}]+")


def mutated(rng: Generator, seed: bytes, *, as_text: bool) -> bytes:
    """Damage a file in one to four places."""
    data = bytearray(seed)
    for _ in range(int(rng.choice([1, 1, 1, 2, 2, 3, 4]))):
        kinds = TEXT_KINDS if as_text and rng.random() < 0.9 else BINARY_KINDS
        kinds[int(rng.integers(len(kinds)))](rng, data)
        if not data:
            break
    return bytes(data)


def _at(rng: Generator, data: bytearray) -> int:
    return int(rng.integers(max(len(data), 1)))


def _flip(rng: Generator, data: bytearray) -> None:
    for _ in range(int(rng.integers(1, 9))):
        if data:
            data[_at(rng, data)] ^= 1 << int(rng.integers(8))


def _randomise(rng: Generator, data: bytearray) -> None:
    at, size = _at(rng, data), int(rng.integers(1, 64))
    data[at : at + size] = rng.integers(0, 256, size, dtype=np.uint8).tobytes()


def _number(rng: Generator, data: bytearray) -> None:
    """Put an extreme number over a field of some width, in either byte order."""
    width = int(rng.choice([1, 2, 4, 8]))
    value = NUMBERS[int(rng.integers(len(NUMBERS)))] % (1 << (8 * width))
    at = _at(rng, data)
    data[at : at + width] = value.to_bytes(width, str(rng.choice(["little", "big"])))  # type: ignore[arg-type]


def _cut(rng: Generator, data: bytearray) -> None:
    del data[_at(rng, data) :]


def _remove(rng: Generator, data: bytearray) -> None:
    at = _at(rng, data)
    del data[at : at + int(rng.integers(1, 1 + min(len(data), 4096)))]


def _repeat(rng: Generator, data: bytearray) -> None:
    at, size = _at(rng, data), int(rng.integers(1, 2048))
    part = bytes(data[at : at + size])
    data[at:at] = part * int(rng.integers(1, 4))


def _move(rng: Generator, data: bytearray) -> None:
    at, to, size = _at(rng, data), _at(rng, data), int(rng.integers(1, 512))
    part = bytes(data[at : at + size])
    data[to : to + len(part)] = part


def _word(rng: Generator, data: bytearray) -> None:
    """Replace a word by one that does not belong there."""
    words = list(_WORD.finditer(bytes(data)))
    if words:
        chosen = words[int(rng.integers(len(words)))]
        data[chosen.start() : chosen.end()] = WORDS[int(rng.integers(len(WORDS)))]


def _insert(rng: Generator, data: bytearray) -> None:
    data[_at(rng, data) : 0] = WORDS[int(rng.integers(len(WORDS)))]


def _drop_word(rng: Generator, data: bytearray) -> None:
    words = list(_WORD.finditer(bytes(data)))
    if words:
        chosen = words[int(rng.integers(len(words)))]
        del data[chosen.start() : chosen.end()]


def _swap_lines(rng: Generator, data: bytearray) -> None:
    lines = bytes(data).split(b"\n")
    one, other = rng.integers(len(lines), size=2)
    lines[one], lines[other] = lines[other], lines[one]
    data[:] = b"\n".join(lines)


def _indent(rng: Generator, data: bytearray) -> None:
    lines = bytes(data).split(b"\n")
    one = int(rng.integers(len(lines)))
    lines[one] = b" " * int(rng.integers(0, 9)) + lines[one].lstrip()
    data[:] = b"\n".join(lines)


BINARY_KINDS = (_flip, _randomise, _number, _number, _cut, _remove, _repeat, _move)
TEXT_KINDS = (_word, _word, _word, _insert, _drop_word, _swap_lines, _indent, _repeat, _cut)
