# SPDX-License-Identifier: Apache-2.0
"""The particle fluid on a graphics card: the same equations as ``cwmav_sim.sph``, one thread per particle."""
