"""What can go wrong for a user, in the user's words, and the exit status that goes with it."""

EXIT_DONE = 0
EXIT_BAD_INPUT = 2
EXIT_NOT_TRUSTED = 3
EXIT_INTERRUPTED = 130


class InputError(ValueError):
    """The user's input is at fault.

    The message is one line that names what was given, where (file, line, column), what is expected
    and what to do next. The command line prints it as it is and exits with 2, without a traceback.
    """


class RowError(InputError):
    """A value of a light curve is at fault; a reader can say on which line of which file it is.

    Parameters
    ----------
    name : field of `LightCurve`
    fault : what is wrong, e.g. "has 3 values <= 0"
    row : index of the first point at fault
    value : that value, as shown to the user
    remedy : what to do next
    """

    def __init__(self, name: str, fault: str, row: int, value: object, remedy: str) -> None:
        super().__init__(f"{name} {fault} (first at index {row}: {value}); {remedy}")
        self.name, self.fault, self.row, self.value, self.remedy = name, fault, row, value, remedy

    def located(self, label: str, place: str) -> InputError:
        """The same fault in the words of a file: its column and, e.g., "pass.csv, line 43"."""
        return InputError(f"{label} {self.fault} (first in {place}: {self.value}); {self.remedy}")
