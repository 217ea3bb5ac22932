# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Readings to trajectory and map: the interchangeable SLAM backends, by name.

A backend is a class with the methods of `slarm_graph.backend.SlamBackend` and the constructor
`(config: RunConfig, rng: numpy.random.Generator, heartbeat: Heartbeat)`. Other packages add theirs
with an entry point in the group `slarm_graph.backends`.
"""

from __future__ import annotations

import importlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from importlib.metadata import entry_points
from typing import TYPE_CHECKING, cast

from slarm_graph.errors import BadInput

if TYPE_CHECKING:
    from numpy.random import Generator

    from slarm_graph.backend import Heartbeat, SlamBackend
    from slarm_graph.config import RunConfig

    Maker = Callable[[RunConfig, Generator, Heartbeat], SlamBackend]

ENTRY_POINT_GROUP = "slarm_graph.backends"

_BUILT_IN = {
    "odometry": "slarm_graph.backends.odometry:OdometryBackend",
    "gmapping": "slarm_graph.backends.gmapping:GmappingBackend",
    "pose_graph": "slarm_graph.backends.pose_graph:PoseGraphBackend",
}


@dataclass(frozen=True, slots=True)
class BackendStatus:
    """A registered backend and whether it can be used.

    Parameters
    ----------
    name : str
    place : str
        `module:attribute` it is loaded from.
    summary : str
        First line of its documentation.
    problem : str
        Why it cannot be used; empty when it can.
    """

    name: str
    place: str
    summary: str = ""
    problem: str = ""


def registered() -> Mapping[str, str]:
    """Return `module:attribute` of every backend by name; outsiders cannot replace built-ins."""
    found = {entry.name: entry.value for entry in entry_points(group=ENTRY_POINT_GROUP)}
    return found | _BUILT_IN


def find(name: str) -> str:
    """Return the `module:attribute` of a backend.

    Raises
    ------
    BadInput
        When there is none of that name.
    """
    places = registered()
    if name not in places:
        raise BadInput(f"no backend '{name}'; there are {', '.join(sorted(places))}")
    return places[name]


def statuses() -> tuple[BackendStatus, ...]:
    """Try to load every backend and tell what came of it."""
    return tuple(_status(name, place) for name, place in registered().items())


def make(name: str, config: RunConfig, rng: Generator, heartbeat: Heartbeat) -> SlamBackend:
    """Build a backend by name.

    Raises
    ------
    BadInput
        When there is no such backend, or something it needs is not installed.
    """
    place = find(name)
    try:
        maker = _load(place)
    except (ImportError, AttributeError) as error:
        raise BadInput(f"backend {name} cannot be used: {_problem(error)}") from error
    return maker(config, rng, heartbeat)


def _status(name: str, place: str) -> BackendStatus:
    try:
        documentation = _load(place).__doc__ or ""
    except (ImportError, AttributeError) as error:
        return BackendStatus(name, place, problem=_problem(error))
    return BackendStatus(name, place, summary=documentation.strip().partition("\n")[0])


def _load(place: str) -> Maker:
    module, _, attribute = place.partition(":")
    return cast("Maker", getattr(importlib.import_module(module), attribute))


def _problem(error: Exception) -> str:
    missing = getattr(error, "name", None)
    if isinstance(error, ModuleNotFoundError) and missing:
        return f"it needs the Python module {missing}, which is not installed"
    return str(error)
