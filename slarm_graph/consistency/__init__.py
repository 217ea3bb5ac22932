# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Self-consistency of a trajectory, from scans and poses alone, without ground truth."""

from slarm_graph.consistency.conflict_places import ConflictPlace as ConflictPlace
from slarm_graph.consistency.pairs import VisitPairs as VisitPairs
from slarm_graph.consistency.pairs import cross_check as cross_check
from slarm_graph.consistency.tears import Tear as Tear
from slarm_graph.consistency.verdict import Contradictions as Contradictions
from slarm_graph.consistency.verdict import Verdict as Verdict
from slarm_graph.consistency.verdict import contradictions as contradictions
from slarm_graph.consistency.views import View as View
from slarm_graph.consistency.views import clear_beams as clear_beams
from slarm_graph.consistency.views import count_known as count_known
from slarm_graph.consistency.views import evidence_against as evidence_against
from slarm_graph.consistency.views import view_of as view_of
from slarm_graph.consistency.visits import Visits as Visits
from slarm_graph.consistency.visits import build_visits as build_visits
