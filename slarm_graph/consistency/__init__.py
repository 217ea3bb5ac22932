# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Does a trajectory contradict itself? Judged from scans and poses alone, without any truth."""

from slarm_graph.consistency.pairs import VisitPairs, cross_check
from slarm_graph.consistency.places import ConflictPlace
from slarm_graph.consistency.tears import Tear
from slarm_graph.consistency.verdict import Contradictions, Verdict, contradictions
from slarm_graph.consistency.views import View, evidence_against, view_of
from slarm_graph.consistency.visits import Visits, build_visits

__all__ = [
    "ConflictPlace",
    "Contradictions",
    "Tear",
    "Verdict",
    "View",
    "VisitPairs",
    "Visits",
    "build_visits",
    "contradictions",
    "cross_check",
    "evidence_against",
    "view_of",
]
