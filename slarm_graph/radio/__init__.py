# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Path loss, line of sight and fading: the radio map and its files."""

BUILT_IN: dict[str, str] = {}
