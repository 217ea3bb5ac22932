# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""The shared scan frontend: filters, matchers, tracking, submaps, loop closure."""
