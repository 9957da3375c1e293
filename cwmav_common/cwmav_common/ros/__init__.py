# SPDX-License-Identifier: Apache-2.0
"""What the three nodes share: parameters, diagnostics, deferred answers, codecs, recording, start and stop.

This is the only layer, with the nodes themselves, that imports rclpy and message packages.
"""
