# SPDX-License-Identifier: Apache-2.0
"""Reliability-based design optimisation with Kriging: for the wing study, and for problems given as files."""
