# SPDX-License-Identifier: Apache-2.0
"""Solvers of the problem kinds ``rbdo``, ``reliability`` and ``global``, on surrogates."""
