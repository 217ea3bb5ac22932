# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Cells: walks along lines, filled polygons, distances, patches, thin lines; one home for each."""
