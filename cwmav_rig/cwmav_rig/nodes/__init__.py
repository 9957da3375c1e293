# SPDX-License-Identifier: Apache-2.0
"""The rig as a ROS 2 node."""
