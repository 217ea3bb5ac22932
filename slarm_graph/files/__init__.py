# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Files in and out: trajectories, maps, graphs, configurations, worlds."""
