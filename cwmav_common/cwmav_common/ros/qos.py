# SPDX-License-Identifier: Apache-2.0
"""Qualities of service of the suite's topics."""

from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy

LATCHED = QoSProfile(
    depth=1, reliability=ReliabilityPolicy.RELIABLE, durability=DurabilityPolicy.TRANSIENT_LOCAL
)
"""Configuration, estimates, state of the optimiser: late subscribers get the last one."""

STREAM = QoSProfile(depth=200, reliability=ReliabilityPolicy.RELIABLE, history=HistoryPolicy.KEEP_LAST)
"""Replayed and simulated data: deep, and nothing is lost while a reader keeps up on average."""
