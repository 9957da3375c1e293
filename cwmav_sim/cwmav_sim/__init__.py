# SPDX-License-Identifier: Apache-2.0
"""Lift of clapping wings by smoothed particle hydrodynamics.

Compiled kernels are kept in a folder named after the fingerprint of everything that runs them. The compiler's
own rule looks only at the file of the outermost kernel, so an edit of an inlined formula would go on running
as it was before.
"""

from pathlib import Path

import numba

from cwmav_sim.fingerprint import kernel_hash

__version__ = "0.1.0"

_ROOT = Path(numba.config.CACHE_DIR or Path(__file__).parent / "__pycache__")
numba.config.CACHE_DIR = str(_ROOT / f"kernels-{kernel_hash()}")
