# SPDX-License-Identifier: Apache-2.0
"""Simulated devices that speak the protocols of the real ones, for tests and for trying things out."""
