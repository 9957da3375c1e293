# SPDX-License-Identifier: Apache-2.0
"""Between the rig and ROS: settings of the node, replay onto topics, work of its process, codecs."""
