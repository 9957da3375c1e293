# SPDX-License-Identifier: Apache-2.0
"""The two ways a program of the suite ends other than well.

Every expected failure is one of these. The command line turns them into an exit status and one line on
standard error, a node into ``success: false`` with a message. Anything else is a defect, with a traceback.
"""


class CwmavError(Exception):
    """Common root, for callers who want to catch both."""

    exit_status = 1


class InputError(CwmavError, ValueError):
    """Bad usage or bad input; the message names the file or option, the value, and what is allowed."""

    exit_status = 2


class WorkError(CwmavError, RuntimeError):
    """The input was right and the work failed; the message says why and what was saved."""

    exit_status = 1


class CancelledError(WorkError):
    """The caller asked the work to stop."""
