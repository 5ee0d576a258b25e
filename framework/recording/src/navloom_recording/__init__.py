"""Recordings: all messages of a robot in one MCAP file, written, read, replayed and checked.

Begin with `writer.py` and `reader.py`; a killed recorder loses at most 0.3 s, and a torn end is skipped and reported.
`step_replay.py` repeats nodes step by step on the inputs that their step records name; `replay_check.py` compares
the bytes; `substitutes.py` tries another plugin on recorded inputs. `imported_log.py` is the base of log importers.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from navloom.parts import lazy_names

if TYPE_CHECKING:
    from navloom_recording.imported_log import OWN_PORTS as OWN_PORTS
    from navloom_recording.imported_log import PERIOD as PERIOD
    from navloom_recording.imported_log import RANGE_SCAN as RANGE_SCAN
    from navloom_recording.imported_log import SWEEP as SWEEP
    from navloom_recording.imported_log import ImportedLog as ImportedLog
    from navloom_recording.imported_log import imported_config as imported_config
    from navloom_recording.imported_log import late_note as late_note
    from navloom_recording.imported_log import mount_option as mount_option
    from navloom_recording.imported_log import placed_in_map as placed_in_map
    from navloom_recording.imported_log import scans_alone as scans_alone
    from navloom_recording.imported_log import start_option as start_option
    from navloom_recording.imported_log import too_coarse as too_coarse
    from navloom_recording.imported_log import writing as writing
    from navloom_recording.reader import RawRecorded as RawRecorded
    from navloom_recording.reader import Recorded as Recorded
    from navloom_recording.reader import Recording as Recording
    from navloom_recording.recording_header import RecordingError as RecordingError
    from navloom_recording.recording_header import RecordingHeader as RecordingHeader
    from navloom_recording.recording_header import header_of as header_of
    from navloom_recording.writer import RecordingWriter as RecordingWriter
    from navloom_recording.writer import WriteError as WriteError
else:
    __all__, __getattr__ = lazy_names(
        "navloom_recording",
        {
            "navloom_recording.recording_header": "RecordingError RecordingHeader header_of",
            "navloom_recording.imported_log": (
                "OWN_PORTS PERIOD RANGE_SCAN SWEEP ImportedLog imported_config late_note mount_option placed_in_map "
                "scans_alone start_option too_coarse writing"
            ),
            "navloom_recording.reader": "RawRecorded Recorded Recording",
            "navloom_recording.writer": "RecordingWriter WriteError",
        },
    )
