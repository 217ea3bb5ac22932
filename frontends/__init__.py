# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Sensors to readings and measurements: sources, simulator, scan frontend, scan matchers."""
