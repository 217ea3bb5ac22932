# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Simulated worlds as sources of readings: robot, laser, odometry and receiver."""
