# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Configuration as YAML, optionally with every key's meaning, unit and allowed values."""

from __future__ import annotations

import types
from collections.abc import Iterator
from typing import Literal, Union, get_args, get_origin

import yaml
from annotated_types import Ge, Gt, Le, Lt
from pydantic.fields import FieldInfo

from slarm_graph import parts
from slarm_graph.config import PartName, RunConfig, Stage
from slarm_graph.errors import BadInput

_UNITS = {
    "_m_per_sqrt_m": "m/sqrt(m)",
    "_rad_per_m": "rad/m",
    "_m_s2": "m/s^2",
    "_m_s": "m/s",
    "_rad_s": "rad/s",
    "_m2": "m^2",
    "_m": "m",
    "_s": "s",
    "_rad": "rad",
    "_deg": "deg",
    "_db": "dB",
    "_dbm": "dBm",
    "_hz": "Hz",
    "_mb": "MB",
    "_ns": "ns",
}
"""Units by suffix of the key; the first match counts."""

_LIMITS = ((Gt, "gt", "above"), (Ge, "ge", "at least"), (Lt, "lt", "below"), (Le, "le", "at most"))


def config_yaml(config: RunConfig, *, comments: bool = False) -> str:
    """Write keys and values as YAML that `load_config` reads back.

    Parameters
    ----------
    config : RunConfig
    comments : bool
        Add every key's meaning above it, unit and allowed values behind it, and the sections of all
        parts, not only of the chosen ones.
    """
    lines = list(_lines(config, "", comments=comments))
    sections = config.sections()
    for name in parts.section_names() if comments else ():
        try:
            sections.setdefault(name, config.section(name))
        except BadInput as error:
            lines += ["", f"# {error}"]
    for name, section in sections.items():
        if type(section).model_fields:
            lines += _section_lines(name, section, "", comments=comments)
    return "\n".join(lines).strip() + "\n"


def allowed(field: FieldInfo) -> str:
    """Describe the values that a setting may have; empty where any of its type is allowed."""
    said = [f"{word} {getattr(m, of):g}" for m in field.metadata for t, of, word in _LIMITS
            if isinstance(m, t)]  # fmt: skip
    for mark in field.metadata:
        if isinstance(mark, PartName):
            said.append(", ".join(parts.registered(mark.kind)))
    kinds = _alternatives(field.annotation)
    said += [", ".join(map(str, get_args(k))) for k in kinds if get_origin(k) is Literal]
    said += ["true, false"] if bool in kinds else []
    return ", ".join(said) + (" or null" if said and type(None) in kinds else "")


def unit(key: str) -> str:
    """Return the unit of a key by its suffix."""
    return next((unit for end, unit in _UNITS.items() if key.endswith(end)), "")


def _alternatives(annotation: object) -> tuple[object, ...]:
    union = get_origin(annotation) in (Union, types.UnionType)
    return get_args(annotation) if union else (annotation,)


def _lines(stage: Stage, indent: str, *, comments: bool) -> Iterator[str]:
    """Yield the YAML lines of a stage and of those below it."""
    for key, field in type(stage).model_fields.items():
        value = getattr(stage, key)
        doc = (field.description or "") if comments else ""
        if isinstance(value, Stage):
            yield from _section_lines(key, value, indent, doc, comments=comments)
            continue
        yield from _comment(doc, indent, gap=False)
        text = yaml.safe_dump(stage.model_dump(mode="json", include={key}), width=1000)
        first, *more = text.splitlines()
        behind = ", ".join(word for word in (unit(key), allowed(field)) if word and comments)
        yield f"{indent}{first}  # {behind}" if behind else f"{indent}{first}"
        yield from (f"{indent}{line}" for line in more)


def _section_lines(
    key: str, stage: Stage, indent: str, doc: str = "", *, comments: bool
) -> Iterator[str]:
    title = (type(stage).__doc__ or "").strip().splitlines()[0] if comments else ""
    yield from _comment(doc or title, indent, gap=not indent)
    yield f"{indent}{key}:" if type(stage).model_fields else f"{indent}{key}: {{}}"
    yield from _lines(stage, f"{indent}  ", comments=comments)


def _comment(text: str, indent: str, *, gap: bool) -> Iterator[str]:
    if text and gap:
        yield ""
    yield from (f"{indent}# {line}".rstrip() for line in text.splitlines())
