# SPDX-License-Identifier: Apache-2.0
"""The way to the workers of a ``dask.distributed`` cluster."""

from __future__ import annotations

from typing import Any

from cwmav_common.errors import InputError

_PATIENCE = 15.0  # s for a scheduler to answer


def connect(address: str, setting: str) -> Any:
    """Return a client of the scheduler at an address such as ``tcp://host:8786``.

    Parameters
    ----------
    address : str
        Of the scheduler.
    setting : str
        The option or key that named it, for messages.

    Raises
    ------
    InputError
        The package is not installed here, or nobody answers at the address.
    """
    try:
        import distributed
    except ImportError:
        raise InputError(f"{setting} needs the package distributed: pip install 'cwmav[cluster]'") from None
    client: Any = distributed.Client
    try:
        return client(address, timeout=_PATIENCE, set_as_default=False)
    except (OSError, ValueError) as error:
        raise InputError(
            f"{setting}: no scheduler answers at {address} ({' '.join(str(error).split())})"
        ) from None


def threads(client: Any) -> int:
    """Return the threads of all workers there now; one while there is none, so that work waits."""
    total: int = sum(client.nthreads().values())
    return max(1, total)
