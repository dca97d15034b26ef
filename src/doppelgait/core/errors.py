"""The errors and the warning that a user of doppelgait can meet."""


class DoppelgaitError(Exception):
    """Root of every error raised on purpose: its text names what is wrong, what is allowed and what to do."""

    exit_code = 2
    """Exit status of the command line: 2 wrong usage or input, 1 the work failed."""


class ConfigError(DoppelgaitError):
    """A parameter, a key of a configuration file or a combination of them is not allowed."""


class MotionError(DoppelgaitError):
    """A motion recording cannot be read, or cannot be used as a radar target."""


class RecordingError(DoppelgaitError):
    """A radar recording cannot be read or written."""


class AnalysisError(DoppelgaitError):
    """A recording cannot be analysed as asked."""


class DatasetError(DoppelgaitError):
    """A dataset cannot be planned, built, opened or extended."""


class OutputError(DoppelgaitError):
    """A result cannot be written: no folder, no right, a full disk. What was there before is untouched."""

    exit_code = 1


class DoppelgaitWarning(UserWarning):
    """Something works but not as the user may think: aliasing, a target outside the frame, dropped markers."""
