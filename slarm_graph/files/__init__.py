# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Readers and writers of trajectories, maps, pose graphs, configurations and worlds."""
