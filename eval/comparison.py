# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Statistics of many runs: summaries over seeds and sources, paired differences."""

from __future__ import annotations

import math
from collections import Counter, defaultdict
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import combinations

import numpy as np

from slarm_graph.eval.bootstrap import nested_interval
from slarm_graph.eval.metric_table import headlines, kind_of
from slarm_graph.geometry import Floats

ALL_SOURCES = "all sources"
_LOST = "inconsistent"
"""Verdict of a run whose map contradicts itself throughout."""
_ALL_PAIRS_UP_TO = 4
"""Up to so many variants every pair is compared; of more, each with the first."""
FEWEST_CLEAR = 6
"""Fewest independent pairs of a clear difference: by chance, six have one sign in 2 / 2^6 = 0.03 of
the cases, five in 0.06 (sign test). Over fewer an interval excludes 0 by chance too often."""


@dataclass(frozen=True, slots=True)
class Outcome:
    """The outcome of one run of a comparison.

    Parameters
    ----------
    source, backend : str
    seed : int
    status : str
        `ok`, `partial` or `failed`, as in `run.json`; `missing` where it was not started.
    problem : str
        Why it is not `ok`.
    folder : str
        The run's folder, relative to the comparison's.
    figures : mapping of str to float
        Metrics, and time and memory from the run's record.
    setting : str
        Swept settings, as `KEY=VALUE` words.
    verdict : str
        The run's verdict on its own consistency; empty without one.
    """

    source: str
    backend: str
    seed: int
    status: str
    problem: str = ""
    folder: str = ""
    figures: Mapping[str, float] = field(default_factory=dict)
    setting: str = ""
    verdict: str = ""

    @property
    def variant(self) -> str:
        """The backend with its swept setting, which is what is compared."""
        return f"{self.backend} {self.setting}".strip()

    @property
    def lost(self) -> bool:
        """Whether it finished with the verdict that its result is inconsistent."""
        return self.status == "ok" and self.verdict == _LOST


@dataclass(frozen=True, slots=True)
class Spread:
    """A metric over the runs that have it: mean, standard deviation, median, worst, interval."""

    mean: float
    sd: float
    median: float
    worst: float
    count: int
    interval: tuple[float, float] = (math.nan, math.nan)


def spread(by_source: Sequence[Sequence[float]], *, more_is_better: bool = False) -> Spread:
    """Summarise the values of every source.

    The worst is the largest, or the smallest where more is better.
    """
    groups = [np.array(values, dtype=np.float64) for values in by_source if len(values)]
    if not groups:
        return Spread(math.nan, math.nan, math.nan, math.nan, 0)
    v = np.concatenate(groups)
    # About the first: of equal values it is 0 and not what rounding leaves of their mean.
    sd = float((v - v[0]).std(ddof=1)) if len(v) > 1 else 0.0
    worst = float(v.min() if more_is_better else v.max())
    return Spread(float(v.mean()), sd, float(np.median(v)), worst, len(v), nested_interval(groups))


@dataclass(frozen=True, slots=True)
class Group:
    """The runs of one variant on one source, or on all.

    Parameters
    ----------
    source, variant : str
    runs : int
    ok, lost, failed : int
        Finished runs; those of them with an inconsistent result; all other runs.
    spreads : mapping of str to Spread
        By metric, over the finished runs.
    problems : str
        Why the others did not finish.
    """

    source: str
    variant: str
    runs: int
    ok: int
    lost: int
    failed: int
    spreads: Mapping[str, Spread]
    problems: str


def headlines_of(outcomes: Iterable[Outcome]) -> list[str]:
    """Return the names of the short tables' metrics that any run has."""
    known = {name for outcome in outcomes for name in outcome.figures}
    return [kind.name for kind in headlines() if kind.name in known]


def groups(outcomes: Sequence[Outcome]) -> list[Group]:
    """Summarise every variant on every source and, where there are several, on all of them."""
    found = []
    sources = list(dict.fromkeys(o.source for o in outcomes))
    for source in [*sources, *([ALL_SOURCES] if len(sources) > 1 else [])]:
        mine = [o for o in outcomes if source in (o.source, ALL_SOURCES)]
        found += [_group(source, variant, runs) for variant, runs in _by_variant(mine)]
    return found


def _by_variant(outcomes: Sequence[Outcome]) -> Iterator[tuple[str, list[Outcome]]]:
    for variant in dict.fromkeys(o.variant for o in outcomes):
        yield variant, [o for o in outcomes if o.variant == variant]


def _group(source: str, variant: str, outcomes: Sequence[Outcome]) -> Group:
    good = [o for o in outcomes if o.status == "ok"]
    spreads = {}
    for name in headlines_of(good):
        values: dict[str, list[float]] = defaultdict(list)
        for outcome in good:
            if name in outcome.figures:
                values[outcome.source].append(outcome.figures[name])
        spreads[name] = spread(list(values.values()), more_is_better=kind_of(name).better == "more")
    counted = Counter(f"{o.status}: {o.problem}" for o in outcomes if o.status != "ok")
    problems = "; ".join(f"{n} x {p}" if n > 1 else p for p, n in sorted(counted.items()))
    lost = sum(o.lost for o in outcomes)
    runs, ok = len(outcomes), len(good)
    return Group(source, variant, runs, ok, lost, runs - ok, spreads, problems)


@dataclass(frozen=True, slots=True)
class Difference:
    """The difference of a metric between two variants, over common sources and seeds.

    Parameters
    ----------
    figure, variant, than : str
    mean : float
        Mean of the paired differences, in the metric's unit.
    interval : (float, float)
        95 % bootstrap interval of it, over sources and, in each, seeds.
    pairs : int
        Pairs of runs of the same source and seed that both have the metric.
    independent : int
        How many of them are independent: one per source, or per seed of a single source.
    """

    figure: str
    variant: str
    than: str
    mean: float
    interval: tuple[float, float]
    pairs: int
    independent: int

    @property
    def is_clear(self) -> bool:
        """Whether the difference is beyond chance."""
        low, high = self.interval
        return self.independent >= FEWEST_CLEAR and (low > 0.0 or high < 0.0)


def differences(outcomes: Sequence[Outcome]) -> list[Difference]:
    """Compare variants over the runs that they have in common."""
    good = [o for o in outcomes if o.status == "ok"]
    variants = list(dict.fromkeys(o.variant for o in outcomes))
    if len(variants) <= _ALL_PAIRS_UP_TO:
        couples = list(combinations(variants, 2))
    else:
        couples = [(variants[0], other) for other in variants[1:]]
    found = []
    for name in headlines_of(good):
        by_run = {(o.variant, o.source, o.seed): o.figures[name] for o in good if name in o.figures}
        for than, variant in couples:
            apart: dict[str, list[float]] = defaultdict(list)
            for (mine, source, seed), value in by_run.items():
                if mine == variant and (than, source, seed) in by_run:
                    apart[source].append(value - by_run[than, source, seed])
            if apart:
                found.append(_difference(name, variant, than, [*map(np.array, apart.values())]))
    return found


def _difference(figure: str, variant: str, than: str, by_source: Sequence[Floats]) -> Difference:
    values = np.concatenate(by_source)
    independent = len(by_source) if len(by_source) > 1 else len(values)
    interval = nested_interval(by_source)
    return Difference(
        figure, variant, than, float(values.mean()), interval, len(values), independent
    )
