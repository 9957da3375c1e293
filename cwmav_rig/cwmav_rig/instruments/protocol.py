# SPDX-License-Identifier: Apache-2.0
"""What every instrument offers, and what it gives."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, Protocol

from cwmav_common.errors import WorkError


class InstrumentError(WorkError):
    """An instrument cannot be reached, is not what it should be, or stopped answering."""


@dataclass(frozen=True)
class Identity:
    """What an instrument says it is, and facts such as its calibration that belong into the recording."""

    name: str
    details: dict[str, str] = field(default_factory=dict)


@dataclass(frozen=True)
class Reading:
    """One message of an instrument.

    Attributes
    ----------
    topic, type_name
        Where it belongs and what it is.
    message
        Its content (see :mod:`cwmav_common.interfaces`).
    samples
        Samples in it.
    lost
        Samples known to be missing before it.
    """

    topic: str
    type_name: str
    message: Any
    samples: int = 1
    lost: int = 0


class Instrument(Protocol):
    """An instrument. A session calls everything from one thread per instrument.

    Attributes
    ----------
    name
        Short name in diagnostics and messages.
    stall
        Seconds without a reading after which it counts as unplugged.
    rate
        Samples per second that are expected; 0 where it is not known.
    """

    name: str
    stall: float
    rate: float

    def open(self) -> Identity:
        """Connect and identify.

        Raises
        ------
        InstrumentError
            It does not answer, or answers with something else.
        """

    def start(self) -> None:
        """Begin to stream."""

    def read(self) -> list[Reading]:
        """Wait at most a tenth of a second and give what came since; raises InstrumentError."""

    def stop(self) -> None:
        """Stop streaming; the connection stays. Does nothing when it does not stream."""

    def close(self) -> None:
        """Disconnect; must not fail, whatever the state."""
