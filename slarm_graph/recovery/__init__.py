# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""From an occupancy grid to the geographic map (GGMR's map recovery)."""
