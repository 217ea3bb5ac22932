# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Planning with a radio map: coverage, best server, SINR, new sites, and connected paths."""
