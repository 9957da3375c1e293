# SPDX-License-Identifier: Apache-2.0
"""What the simulation, the rig and the optimiser share: errors, settings, manners, file formats."""
