# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Planning with a radio map: where there is connection, whose, how good, and ways that keep it."""
