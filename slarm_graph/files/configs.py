# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Reading of configurations from YAML with overrides, and their comparison."""

from __future__ import annotations

import difflib
import inspect
from collections.abc import Iterable, Iterator, Mapping
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING

from pydantic import BaseModel, ValidationError

from slarm_graph import parts
from slarm_graph.config import RunConfig, Stage
from slarm_graph.errors import MOST_LISTED, BadInput, brief, most
from slarm_graph.files.yaml_text import parse_yaml, read_yaml

if TYPE_CHECKING:
    from pydantic_core import ErrorDetails

_SETTING = "--set"
MAX_KEY = 80
"""Longest unknown key that is compared with the known ones; the longest known has 45."""

Tree = dict[str, object]
"""Nested keys and values, as in the YAML."""


def load_config(path: Path | None = None, overrides: Iterable[str] = ()) -> RunConfig:
    """Build a configuration from the defaults, a file and overrides, in this order.

    Parameters
    ----------
    path : Path, optional
        YAML with any subset of the keys.
    overrides : iterable of str
        Each `key=value` with a dotted key, such as `mapping.resolution_m=0.1`; the value is YAML.

    Raises
    ------
    BadInput
        With a line for every problem: place and nearest match of an unknown key, or the invalid
        value.
    """
    tree: Tree = {}
    places: dict[str, str] = {}
    if path is not None:
        tree, places = _read(path)
    for override in overrides:
        key, value = _split(override)
        places[key] = _SETTING
        _put(tree, key, value)
    try:
        return RunConfig.model_validate(tree)
    except ValidationError as error:
        found = error.errors(include_url=False, include_context=False)
        problems = (_problem(e, places) for e in found[: 2 * MOST_LISTED])
        raise BadInput(*most(tuple(dict.fromkeys(problems)))) from None


def _read(path: Path) -> tuple[Tree, dict[str, str]]:
    """Return the content and the place (`file:line`) of every dotted key."""
    document = read_yaml(path)
    if document.content is None:
        return {}, {}
    if not isinstance(document.content, dict):
        raise BadInput(f"{path}: expected keys and values, as `slarm config` prints them")
    return document.content, {key: f"{path}:{line}" for key, line in document.lines.items()}


def _split(override: str) -> tuple[str, object]:
    key, equals, text = override.partition("=")
    if not equals or not key:
        raise BadInput(f"--set {override}: expected key=value, such as mapping.resolution_m=0.1")
    try:
        return key.strip(), parse_yaml(text, "").content
    except BadInput:
        told = brief(override)
        raise BadInput(f"--set {told}: the value cannot be read as YAML") from None


def _put(tree: Tree, dotted: str, value: object) -> None:
    *parents, last = dotted.split(".")
    for parent in parents:
        below = tree.setdefault(parent, {})
        if not isinstance(below, dict):
            raise BadInput(f"--set {dotted}: '{parent}' has no keys below it")
        tree = below
    tree[last] = value


def _problem(error: ErrorDetails, places: Mapping[str, str]) -> str:
    """Describe a validation error: its place, what is wrong, and what would be right."""
    key = ".".join(str(part) for part in error["loc"])
    given = error["input"]
    below = next((k for k in places if k.startswith(f"{key}.")), None)
    if error["type"] in ("extra_forbidden", "unknown_section"):
        return _unknown(key if key in places else below or key, places)
    if isinstance(given, dict) and below and error["type"] != "model_type":
        return _unknown(below, places)
    reason = error["msg"].removeprefix("Value error, ")
    if error["type"] == "model_type":
        reason = f"Input should be keys and values, such as {_first_key(key)}"
    while key not in places and "." in key:
        key = key.rpartition(".")[0]
    place = places.get(key, "configuration")
    # Options such as --resolution arrive as settings too: the key alone says what is meant.
    where = key if place == _SETTING else f"{place}: {key}"
    return f"{where}: {reason}, got {'nothing' if given is None else brief(given)}"


def _first_key(section: str) -> str:
    known = (*_known_keys(RunConfig), *_known_section_keys())
    return next(key for key in known if key.startswith(f"{section}."))


def _unknown(key: str, places: Mapping[str, str]) -> str:
    known = tuple(_known_keys(RunConfig)) + tuple(_known_section_keys())
    near = difflib.get_close_matches(key[:MAX_KEY], known, n=1, cutoff=0.5)
    near = near or [k for k in known if k.rpartition(".")[2] == key.rpartition(".")[2]]
    hint = f"; did you mean '{near[0]}'?" if near else "; `slarm config` lists them all"
    return f"{places.get(key, '--config')}: unknown key '{brief(key)}'{hint}"


def _known_keys(model: type[BaseModel], prefix: str = "") -> Iterator[str]:
    for name, field in model.model_fields.items():
        yield f"{prefix}{name}"
        if inspect.isclass(field.annotation) and issubclass(field.annotation, Stage):
            yield from _known_keys(field.annotation, f"{prefix}{name}.")


def _known_section_keys() -> Iterator[str]:
    for name in parts.section_names():
        with suppress(BadInput):
            yield from (name, *_known_keys(parts.section_settings(name) or Stage, f"{name}."))


def config_differences(old: RunConfig, new: RunConfig) -> tuple[str, ...]:
    """Return `key: old -> new` for every key that differs."""
    before, after = (dict(_leaves(_complete(c, old, new))) for c in (old, new))
    return tuple(
        f"{key}: {before.get(key)} -> {after.get(key)}"
        for key in sorted(before.keys() | after.keys())
        if before.get(key) != after.get(key)
    )


def _complete(config: RunConfig, *others: RunConfig) -> Tree:
    """Everything that is set, with the sections that any of the others was given.

    What nobody was given is the same in all, and may be of a part that cannot be used here.
    """
    names = {name for other in others for name in other.model_extra or ()}
    sections = {name: config.section(name).model_dump(mode="json") for name in names}
    return config.model_dump(mode="json") | sections


def _leaves(tree: Mapping[str, object], prefix: str = "") -> Iterator[tuple[str, object]]:
    for key, value in tree.items():
        if isinstance(value, dict):
            yield from _leaves(value, f"{prefix}{key}.")
        else:
            yield f"{prefix}{key}", value
