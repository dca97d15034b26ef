"""XeThru recordings in the format of the vendor's recorder."""

from doppelgait.radar.xethru.convert import read_xethru_recording
from doppelgait.radar.xethru.downconvert import down_convert_frames, up_convert_frames
from doppelgait.radar.xethru.reader import XethruRecording, XethruStream, read_xethru, sniff_xethru
from doppelgait.radar.xethru.records import DATA_TYPES, make_records
from doppelgait.radar.xethru.writer import TimedRecord, write_xethru, write_xethru_recording

__all__ = [
    "DATA_TYPES",
    "TimedRecord",
    "XethruRecording",
    "XethruStream",
    "down_convert_frames",
    "make_records",
    "read_xethru",
    "read_xethru_recording",
    "sniff_xethru",
    "up_convert_frames",
    "write_xethru",
    "write_xethru_recording",
]
