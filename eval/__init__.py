# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Results to numbers and pages: trajectory, map and radio metrics, reports."""

BUILT_IN: dict[str, str] = {}
