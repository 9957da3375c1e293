# SPDX-License-Identifier: Apache-2.0
"""Whether there is a graphics card to compute on, and which."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from importlib.util import find_spec

SIMULATOR = "numba simulator"
PACKAGE = "numba-cuda"


@dataclass(frozen=True)
class Card:
    """What was found.

    Attributes
    ----------
    name : str
        Of the card; empty where there is none to use.
    missing : str
        What is missing; empty where there is a card.
    """

    name: str
    missing: str

    @property
    def usable(self) -> bool:
        """Whether kernels can run."""
        return not self.missing


@cache
def find_card() -> Card:
    """Look for the package, the driver with a card, and the compiler of the kernels, in this order."""
    from numba import config, cuda

    if config.ENABLE_CUDASIM:
        return Card(SIMULATOR, "")
    if find_spec("numba_cuda") is None:
        return Card("", f"the package {PACKAGE} (pip install 'cwmav[cuda]')")
    try:
        name = cuda.get_current_device().name
    except Exception as error:  # whatever the driver says is the answer
        return Card("", f"a card with its driver ({_reason(error)})")
    try:
        _try_kernel()
    except Exception as error:
        return Card(
            "", f"the compiler of the kernels for the card (pip install 'cwmav[cuda]'; {_reason(error)})"
        )
    return Card(name.decode() if isinstance(name, bytes) else str(name), "")


def _try_kernel() -> None:
    from cwmav_sim.cuda.launch import clear, zeros

    clear(zeros(1))


def _reason(error: Exception) -> str:
    """Return the first line of an error that says more than where it happened."""
    lines = [line.strip() for line in str(error).splitlines() if line.strip().rstrip(":")]
    return next((line for line in lines if not line.endswith(":")), type(error).__name__).rstrip(".")
