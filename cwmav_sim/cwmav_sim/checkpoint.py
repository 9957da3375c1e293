# SPDX-License-Identifier: Apache-2.0
"""The state of a run in a file, so that an interrupted run goes on where it was."""

from __future__ import annotations

import os
import zipfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cwmav_common.errors import InputError, WorkError

_NAME = "checkpoint.npz"
_ADDRESS = "address"


class Checkpoint:
    """One file in the folder of a run; the newest state replaces the one before as a whole.

    Parameters
    ----------
    folder : Path
        Folder of the run.
    address : str
        Content address of the case, so that no run goes on from the state of another.
    """

    def __init__(self, folder: Path, address: str) -> None:
        self.path, self._address = folder / _NAME, address

    def write(self, state: Mapping[str, NDArray]) -> None:
        """Replace the file; a program killed at any instant leaves either the old or the new one.

        Raises
        ------
        WorkError
            When the folder cannot be written.
        """
        part = self.path.with_suffix(".part")
        arrays: dict[str, Any] = {_ADDRESS: np.array(self._address), **state}
        try:
            self.path.parent.mkdir(parents=True, exist_ok=True)
            with part.open("wb") as file:
                np.savez(file, **arrays)
                file.flush()
                os.fsync(file.fileno())
            part.replace(self.path)
        except OSError as error:
            raise WorkError(f"{self.path}: the checkpoint cannot be written ({error})") from None

    def read(self) -> dict[str, NDArray] | None:
        """Return the state, or None when there is no file.

        Raises
        ------
        InputError
            When the file is damaged or belongs to another case.
        """
        if not self.path.exists():
            return None
        try:
            with self.path.open("rb") as stream, np.load(stream) as file:
                state = {name: file[name] for name in file.files}
        except (OSError, ValueError, KeyError, zipfile.BadZipFile) as error:
            raise InputError(f"{self.path}: is no checkpoint ({error}); delete it to start anew") from None
        address = str(state.pop(_ADDRESS, ""))
        if address != self._address:
            raise InputError(
                f"{self.path}: belongs to case {address or 'unknown'}; allowed: {self._address}; "
                "delete it to start anew"
            )
        return state

    def remove(self) -> None:
        """Delete the file, which a finished run does not need."""
        self.path.unlink(missing_ok=True)
