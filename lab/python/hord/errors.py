"""What a call of `hord` raises: the station's own sentences, what failed and what to do about it."""


class Error(Exception):
    """A call failed. `what` says what failed, `cure` what to do about it; str() joins them."""

    def __init__(self, what: str, cure: str = "") -> None:
        super().__init__(what, cure)
        self.what = what
        self.cure = cure

    def __str__(self) -> str:
        return f"{self.what}: {self.cure}" if self.cure else self.what


class InvalidArgument(Error, ValueError):
    """The call asks for something impossible: bins that do not divide a frame, a recipe with mistakes."""


class NotFound(Error, LookupError):
    """The named file or folder does not exist."""


class Unreadable(Error, ValueError):
    """The file exists, and cannot be read or decoded."""


class Unsupported(Error, NotImplementedError):
    """This build, processor or format cannot do it."""


class Refused(Error):
    """The request was understood and is refused: no lattice in a white frame, too few tilts."""


class IoError(Error):
    """The operating system reported an error."""
