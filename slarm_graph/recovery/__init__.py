# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Map recovery of GGMR: the geographic map from an occupancy grid."""
