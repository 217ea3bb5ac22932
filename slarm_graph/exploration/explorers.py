# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Explorers by name; built when asked for."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

from slarm_graph.errors import BadInput

if TYPE_CHECKING:
    from slarm_graph.config import ExploreConfig
    from slarm_graph.exploration.explorer import Explorer


def make(config: ExploreConfig) -> Explorer:
    """Build the explorer that `config.explorer` names.

    Raises
    ------
    BadInput
        When there is none of that name.
    """
    if config.explorer not in EXPLORERS:
        raise BadInput(f"no explorer '{config.explorer}'; there are {', '.join(EXPLORERS)}")
    return EXPLORERS[config.explorer](config)


def _ggmr(_config: ExploreConfig) -> Explorer:
    from slarm_graph.exploration.ggmr import Ggmr

    return Ggmr()


def _ggmr_plus(config: ExploreConfig) -> Explorer:
    from slarm_graph.exploration.ggmr_plus import GgmrPlus

    return GgmrPlus(config)


def _ba_star(config: ExploreConfig) -> Explorer:
    from slarm_graph.exploration.baselines import BaStar

    return BaStar(config)


def _boustrophedon(config: ExploreConfig) -> Explorer:
    from slarm_graph.exploration.baselines import Boustrophedon

    return Boustrophedon(config)


def _frontier(_config: ExploreConfig) -> Explorer:
    from slarm_graph.exploration.frontier import NearestFrontier

    return NearestFrontier()


EXPLORERS: dict[str, Callable[[ExploreConfig], Explorer]] = {
    "ggmr": _ggmr,
    "ggmr+": _ggmr_plus,
    "ba*": _ba_star,
    "boustrophedon": _boustrophedon,
    "frontier": _frontier,
}
