# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""The application around the core: the flow, run folders, comparisons, the command line."""

BUILT_IN: dict[str, str] = {}
