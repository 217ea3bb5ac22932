# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""The registry: every interchangeable part by kind and name, loaded when asked for.

A part is built in when its room's `BUILT_IN` table names it, next to the part itself::

    # slarm_graph/exploration/__init__.py
    BUILT_IN = {"ggmr+": "slarm_graph.exploration.ggmr_plus:GgmrPlus", ...}

Parts of others come by an entry point of the kind's group (`slarm_graph.backends` and so on) and
cannot replace what is built in. A part says by its attribute `settings`, a
`slarm_graph.config.Stage`, what there is to set in the configuration's section of its name
(`slarm run --set NAME.key=value`); its constructor takes these settings first, and then what its
kind hands down. A setting that chooses a part by name is a `PartName`
(`slarm_graph.config.sections`). A new kind is a row of `KINDS`.
"""

from __future__ import annotations

import difflib
import importlib
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from importlib.metadata import entry_points
from typing import TYPE_CHECKING, Any, cast

from slarm_graph.errors import BadInput

if TYPE_CHECKING:
    from slarm_graph.config import RunConfig, Stage


@dataclass(frozen=True, slots=True)
class Kind:
    """A kind of part.

    Parameters
    ----------
    name : str
        As it is called in messages.
    group : str
        Of the entry points by which other packages add theirs.
    room : str
        Module whose table `BUILT_IN` gives `module:attribute` of those that come along, by name.
    configured : bool
        Whether such a part has a section of its name in the configuration.
    """

    name: str
    group: str
    room: str
    configured: bool = True


KINDS: Mapping[str, Kind] = {
    kind.name: kind
    for kind in (
        Kind("backend", "slarm_graph.backends", "slarm_graph.backends"),
        Kind("matcher", "slarm_graph.matchers", "slarm_graph.frontends.scans"),
        Kind("propagation model", "slarm_graph.propagation_models", "slarm_graph.radio"),
        Kind("explorer", "slarm_graph.explorers", "slarm_graph.exploration"),
        Kind(
            "recording format", "slarm_graph.recording_formats", "slarm_graph.frontends.recordings"
        ),
        Kind("metric", "slarm_graph.metrics", "slarm_graph.eval", configured=False),
        Kind("command", "slarm_graph.commands", "slarm_graph.app", configured=False),
    )
}


@dataclass(frozen=True, slots=True)
class PartStatus:
    """A registered part and whether it can be used.

    Parameters
    ----------
    kind, name : str
    place : str
        `module:attribute` it is loaded from.
    summary : str
        First line of its documentation.
    problem : str
        Why it cannot be used; empty when it can.
    """

    kind: str
    name: str
    place: str
    summary: str = ""
    problem: str = ""


def registered(kind: str) -> Mapping[str, str]:
    """Return `module:attribute` of every part of a kind by name, those built in first."""
    built_in = _built_in(kind)
    return built_in | {n: place for n, place in _added(kind) if n not in built_in}


def find(kind: str, name: str) -> str:
    """Return the `module:attribute` of a part.

    Raises
    ------
    BadInput
        When there is none of that name.
    """
    places = registered(kind)
    if name in places:
        return places[name]
    near = difflib.get_close_matches(name, places, n=1, cutoff=0.5)
    hint = f"; did you mean '{near[0]}'?" if near else ""
    raise BadInput(f"no {kind} '{name}'; there are {', '.join(places) or 'none'}{hint}")


def load(kind: str, name: str) -> Any:
    """Return a part: the class, or for a command or a metric the object itself.

    Raises
    ------
    BadInput
        When there is no such part, or it cannot be used.
    """
    return _loaded(kind, name, find(kind, name))


def make(kind: str, name: str, config: RunConfig, *handed_down: object) -> Any:
    """Build a part with its own settings and what its kind hands down.

    Raises
    ------
    BadInput
        As `load`.
    """
    return load(kind, name)(config.section(name), *handed_down)


def section_names() -> tuple[str, ...]:
    """Return the names of all parts that may have a section in the configuration."""
    kinds = (kind.name for kind in KINDS.values() if kind.configured)
    return tuple(dict.fromkeys(name for kind in kinds for name in registered(kind)))


def section_settings(name: str) -> type[Stage] | None:
    """Return the model of a part's section, an empty one when it has nothing to set.

    None when there is no part of that name.

    Raises
    ------
    BadInput
        When the part cannot be used.
    """
    from slarm_graph.config.stage import Stage

    kind = _owner(name)
    return (
        None if kind is None else cast("type[Stage]", getattr(load(kind, name), "settings", Stage))
    )


def _owner(section: str) -> str | None:
    """Return the kind of the part that a section of the configuration belongs to."""
    kinds = (kind.name for kind in KINDS.values() if kind.configured)
    return next((kind for kind in kinds if section in registered(kind)), None)


def statuses(kind: str) -> tuple[PartStatus, ...]:
    """Try to load every part of a kind, and tell what came of it."""
    built_in = _built_in(kind)
    refused = tuple(
        PartStatus(kind, name, place, problem=f"ignored: there is a built-in {kind} of that name")
        for name, place in _added(kind)
        if name in built_in
    )
    return tuple(_status(kind, name, at) for name, at in registered(kind).items()) + refused


def _status(kind: str, name: str, place: str) -> PartStatus:
    try:
        part = _loaded(kind, name, place)
    except BadInput as error:
        return PartStatus(kind, name, place, problem=str(error))
    return PartStatus(kind, name, place, _summary(part))


def _summary(part: Any) -> str:
    """Return the first line of a part's docstring; of a Typer group, of its help."""
    group = getattr(part, "info", None)
    text = getattr(group, "help", None) or part.__doc__ or ""
    return str(text).strip().partition("\n")[0]


def _loaded(kind: str, name: str, place: str) -> Any:
    module, _, attribute = place.partition(":")
    try:
        part = getattr(importlib.import_module(module), attribute)
    except Exception as error:  # whatever a stranger's module does when it is imported
        raise BadInput(f"{kind} {name} cannot be used: {_reason(error)}") from error
    problem = _section_problem(kind, name, part)
    if problem:
        raise BadInput(f"{kind} {name} cannot be used: {problem}")
    return part


def _section_problem(kind: str, name: str, part: object) -> str:
    """What is wrong with a part's name or settings, which make a section of the configuration."""
    from slarm_graph.config import RunConfig, Stage

    if not KINDS[kind].configured:
        return ""
    model = getattr(part, "settings", Stage)
    if not (isinstance(model, type) and issubclass(model, Stage)):
        return "its `settings` are no class derived from slarm_graph.config.Stage"
    required = [key for key, field in model.model_fields.items() if field.is_required()]
    if required:
        return f"its settings have no default for {', '.join(required)}"
    if "." in name or name in RunConfig.model_fields:
        return "its name cannot be that of a section of the configuration"
    owner = _owner(name)
    return "" if owner == kind else f"there is a {owner} of the same name"


def _reason(error: Exception) -> str:
    missing = getattr(error, "name", None)
    if isinstance(error, ModuleNotFoundError) and missing:
        return f"it needs the Python module {missing}, which is not installed"
    return str(error) or type(error).__name__


def _built_in(kind: str) -> dict[str, str]:
    table: dict[str, str] = importlib.import_module(KINDS[kind].room).BUILT_IN
    return table


@cache
def _added(kind: str) -> tuple[tuple[str, str], ...]:
    """Name and place of what other packages add; of two with one name the first counts."""
    found = {e.name: e.value for e in reversed(tuple(entry_points(group=KINDS[kind].group)))}
    return tuple(sorted(found.items()))
