# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Bounded YAML reader for untrusted files: plain values only, with the line of every key.

Values are built from the parser's events and not by a loader, because loaders build first and check
later: aliases that stand for billions of values, nesting deeper than the stack, tags that name
Python objects.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from pathlib import Path

import yaml
from yaml.constructor import SafeConstructor

from slarm_graph.errors import BadInput, brief
from slarm_graph.files.texts import read_text

MAX_BYTES = 1 << 21
"""2 MB: the largest world that is shipped has 5 kB, and 2 MB are parsed in half a second."""
MAX_VALUES = 120_000
"""Keys, values and containers, with what aliases stand for: some 8,000 boxes of a world. Twice as
many take twice as long, a second on the machine this was measured on."""
MAX_DEPTH = 24
"""Nesting of lists and mappings; the deepest file of ours has five levels."""

_Parser = getattr(yaml, "CSafeLoader", yaml.SafeLoader)
_CONSTRUCT = SafeConstructor()
_PLAIN = {
    "tag:yaml.org,2002:null": _CONSTRUCT.construct_yaml_null,
    "tag:yaml.org,2002:bool": _CONSTRUCT.construct_yaml_bool,
    "tag:yaml.org,2002:int": _CONSTRUCT.construct_yaml_int,
    "tag:yaml.org,2002:float": _CONSTRUCT.construct_yaml_float,
}
_STRING = "tag:yaml.org,2002:str"


@dataclass(frozen=True, slots=True)
class YamlDocument:
    """The content of a YAML text.

    Parameters
    ----------
    content : object
        None, bool, int, float, str, and lists and dictionaries of them; keys are texts.
    lines : dict of str to int
        Line, counted from 1, of every dotted key that is not below a list.
    """

    content: object
    lines: dict[str, int]


def read_yaml(path: Path) -> YamlDocument:
    """Read a YAML file.

    Raises
    ------
    BadInput
        When it cannot be read, with its place and reason.
    """
    return parse_yaml(read_text(path, "YAML", MAX_BYTES), str(path))


def parse_yaml(text: str, where: str) -> YamlDocument:
    """Parse a YAML text; `where` names it in messages.

    Raises
    ------
    BadInput
        When it is no YAML, is too large or too deep, or holds tags or repeated keys.
    """
    if len(text) > MAX_BYTES:
        raise BadInput(
            f"{where}: {len(text) / 1e6:.1f} MB of YAML are too large (at most {MAX_BYTES / 1e6:g})"
        )
    builder = _Builder(where)
    try:
        for event in yaml.parse(text, Loader=_Parser):
            builder.take(event)
    except yaml.YAMLError as error:
        raise BadInput(f"{where}: cannot be read as YAML ({_reason(error)})") from None
    return YamlDocument(builder.content, builder.lines)


def _reason(error: yaml.YAMLError) -> str:
    """Return the error and its place, without the surrounding text."""
    mark = getattr(error, "problem_mark", None)
    problem = getattr(error, "problem", None) or str(error)
    told = brief(str(problem), 100)
    return f"line {mark.line + 1}: {told}" if mark is not None else told


@dataclass(slots=True)
class _Open:
    """A list or mapping that is not complete yet."""

    value: list[object] | dict[str, object]
    anchor: str | None
    before: int
    dotted: str | None
    key: str | None = None


@dataclass(slots=True)
class _Builder:
    """Builds values from events."""

    where: str
    content: object = None
    lines: dict[str, int] = field(default_factory=dict)
    _stack: list[_Open] = field(default_factory=list)
    _anchors: dict[str, tuple[object, int] | None] = field(default_factory=dict)
    _count: int = 0
    _documents: int = 0

    def take(self, event: yaml.Event) -> None:
        """Take the next event of the parser."""
        line = event.start_mark.line + 1 if event.start_mark else 0
        if isinstance(event, yaml.DocumentStartEvent):
            self._documents += 1
            if self._documents > 1:
                raise self._bad(line, "a second document; one is expected")
        elif isinstance(event, yaml.AliasEvent):
            self._alias(event, line)
        elif isinstance(event, yaml.ScalarEvent):
            self._count += 1
            self._put(self._scalar(event, line), line)
            if event.anchor:
                self._anchors[event.anchor] = (self._last, 1)
        elif isinstance(event, (yaml.SequenceStartEvent, yaml.MappingStartEvent)):
            self._begin(event, line)
        elif isinstance(event, (yaml.SequenceEndEvent, yaml.MappingEndEvent)):
            self._end()
        if self._count > MAX_VALUES:
            raise self._bad(line, f"more than {MAX_VALUES} values, aliases expanded")

    _last: object = None

    def _begin(self, event: yaml.CollectionStartEvent, line: int) -> None:
        kind = dict if isinstance(event, yaml.MappingStartEvent) else list
        self._refuse_tag(event.tag, line)
        if len(self._stack) >= MAX_DEPTH:
            raise self._bad(line, f"nested deeper than {MAX_DEPTH} levels")
        if self._wants_key():
            raise self._bad(line, "a key is a list or a mapping; a word is expected")
        if event.anchor:
            self._anchors[event.anchor] = None
        self._stack.append(_Open(kind(), event.anchor, self._count, self._dotted()))
        self._count += 1

    def _end(self) -> None:
        done = self._stack.pop()
        if done.anchor:
            self._anchors[done.anchor] = (done.value, self._count - done.before)
        self._put(done.value, 0)

    def _alias(self, event: yaml.AliasEvent, line: int) -> None:
        name = event.anchor or ""
        known = self._anchors.get(name)
        if known is None:
            problem = "holds itself" if name in self._anchors else "is not defined"
            raise self._bad(line, f"the alias *{brief(name, 20)} {problem}")
        self._count += known[1]
        if self._wants_key() and not isinstance(known[0], str):
            raise self._bad(line, "a key is a list or a mapping; a word is expected")
        self._put(known[0], line)

    def _scalar(self, event: yaml.ScalarEvent, line: int) -> object:
        self._refuse_tag(event.tag, line)
        if not event.implicit[0] or self._wants_key():
            return event.value
        try:
            return _resolved(event.value)
        except ValueError:
            raise self._bad(line, f"{brief(event.value, 30)} is no number") from None

    def _put(self, value: object, line: int) -> None:
        """Put a complete value where it belongs."""
        self._last = value
        if not self._stack:
            self.content = value
            return
        top = self._stack[-1]
        if isinstance(top.value, list):
            top.value.append(value)
        elif top.key is None:
            top.key = str(value)
            if top.key in top.value:
                raise self._bad(line, f"the key '{brief(top.key, 30)}' stands here twice")
            if (dotted := self._dotted()) is not None:
                self.lines[dotted] = line
        else:
            top.value[top.key] = value
            top.key = None

    def _wants_key(self) -> bool:
        return (
            bool(self._stack)
            and isinstance(self._stack[-1].value, dict)
            and (self._stack[-1].key is None)
        )

    def _dotted(self) -> str | None:
        """Return the dotted key of the next value; None below a list."""
        if not self._stack:
            return ""
        top = self._stack[-1]
        if top.dotted is None or top.key is None:
            return None
        return f"{top.dotted}.{top.key}" if top.dotted else top.key

    def _refuse_tag(self, tag: str | None, line: int) -> None:
        if tag not in (None, "!"):
            raise self._bad(line, f"tags such as {brief(tag, 40)} are not read; plain values only")

    def _bad(self, line: int, problem: str) -> BadInput:
        return BadInput(f"{self.where}:{line}: cannot be read as YAML ({problem})")


def _resolved(text: str) -> object:
    """Return a plain text as null, truth value or number by YAML's rules, else as text."""
    resolvers = yaml.SafeLoader.yaml_implicit_resolvers.get(text[:1], [])
    for tag, pattern in resolvers:
        if tag in _PLAIN and pattern.match(text):
            return _PLAIN[tag](yaml.ScalarNode(tag, text))
    return text


def number(value: object) -> float:
    """Read a finite number, also one in quotes; ValueError when it is none."""
    if isinstance(value, bool) or not isinstance(value, (int, float, str)):
        raise ValueError("not a number")
    found = float(value)
    if not math.isfinite(found):
        raise ValueError("not finite")
    return found
