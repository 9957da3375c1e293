# SPDX-License-Identifier: Apache-2.0
"""Files of a finished wing study in its run folder: history, report, recording, and last the result."""

from __future__ import annotations

from cwmav_rbdo.loop import AcceleratedLoop
from cwmav_rbdo.recording import write_recording
from cwmav_rbdo.report import write_report
from cwmav_rbdo.result import Result
from cwmav_rbdo.run_folder import RunFolder


def write_artefacts(folder: RunFolder, loop: AcceleratedLoop, result: Result) -> None:
    """Write everything; the result comes last, because its presence marks a run as finished."""
    folder.write_iterations(result.history)
    if not folder.recording.exists():
        # A node has recorded what was published already.
        write_recording(folder.recording, loop, folder.path.name)
    write_report(folder.report, loop, result)
    folder.write_result(result.to_json())
