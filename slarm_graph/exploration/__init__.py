# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Where to drive: GGMR, the baselines, planning and the closed loop."""
