# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Readers of signal strength: CSV files, logs of Bluetooth anchors, topics of bags."""
