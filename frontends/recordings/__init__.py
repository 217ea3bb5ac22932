# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Recordings to readings: ROS 1 and 2 bags, CARMEN logs; diagnosing and converting them."""

BUILT_IN: dict[str, str] = {}
