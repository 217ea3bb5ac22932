# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""The reproduction of the paper's figures and claims, on the runner of comparisons."""
