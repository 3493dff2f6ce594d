"""What can be wrong with a signal; every message says what was wrong and what would be right."""


class SignalError(ValueError):
    """A signal that cannot be used; the base of all errors of this package."""


class NotAudioError(SignalError):
    """The bytes are no audio that is accepted here: another kind of file, or a lossy format (HTTP 415)."""


class BrokenAudioError(SignalError):
    """Audio whose header or samples are wrong: truncated, lying, not finite, silent, too short (HTTP 422)."""


class ChannelError(BrokenAudioError):
    """The channel asked for is not in the recording (HTTP 422)."""


class RecordingTooLargeError(SignalError):
    """Longer, wider or bigger than the limits allow (HTTP 413)."""


class DecoderUnavailableError(SignalError):
    """The decoding worker could not be started; the recording may be fine (HTTP 503)."""


class TelemetryError(SignalError):
    """A telemetry table that cannot be used (HTTP 422)."""


class ConditionError(SignalError):
    """An operating condition that contradicts itself or physics (HTTP 422)."""


class TextError(SignalError):
    """Bytes that should be text and are none (HTTP 422)."""


class NoPlainFileError(OSError):
    """What was named is a pipe, a device, a socket or a folder, where a file is to be."""
