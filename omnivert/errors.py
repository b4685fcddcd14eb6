"""What omnivert says when it cannot go on: what, where, why, and what to type next."""


class OmnivertError(Exception):
    """A refusal in one line, with its cause and the next thing to try.

    code     OVnnn, stable; the first digit is the room (1 the drive, 2 use, 3 recordings, 4 bus, 5 devices, 6 store)
    what     what is refused, with the file, topic or place in it
    because  the cause in words; may be empty
    help     a command to type or a line to change; may be empty
    """

    exit_code = 1

    def __init__(self, code: str, what: str, because: str = "", help: str = "") -> None:
        super().__init__(code, what, because, help)
        self.code = code
        self.what = what
        self.because = because
        self.help = help

    def __str__(self) -> str:
        return f"{self.what}: {self.because}" if self.because else self.what


class DataError(OmnivertError):
    """The data, or the world outside, do not allow it: exit 1."""


class UseError(OmnivertError):
    """Wrong use: an argument, an option, a configuration: exit 2."""

    exit_code = 2
