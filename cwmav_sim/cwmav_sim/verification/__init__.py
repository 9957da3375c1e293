# SPDX-License-Identifier: Apache-2.0
"""Cases with a known answer, and what this solver makes of them."""

from cwmav_sim.verification.protocol import Check, VerificationCase

__all__ = ["Check", "VerificationCase"]
