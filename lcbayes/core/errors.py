"""Errors caused by user input, with messages for the user, and their exit status."""

EXIT_DONE = 0
EXIT_BAD_INPUT = 2
EXIT_NOT_TRUSTED = 3
EXIT_INTERRUPTED = 130


class InputError(ValueError):
    """The user's input is invalid.

    The message is one line that names the input, its location (file, line, column), the expected
    value and what to do next. The command line prints the message unchanged, without a traceback,
    and exits with status 2.
    """


class RowError(InputError):
    """A value of a light curve is invalid; a reader can add the file and the line.

    Parameters
    ----------
    name : field of `LightCurve`
    fault : what is wrong, e.g. "has 3 values <= 0"
    row : index of the first invalid point
    value : that value, as shown to the user
    remedy : what to do next
    """

    def __init__(self, name: str, fault: str, row: int, value: object, remedy: str) -> None:
        super().__init__(f"{name} {fault} (first at index {row}: {value}); {remedy}")
        self.name, self.fault, self.row, self.value, self.remedy = name, fault, row, value, remedy

    def located(self, label: str, place: str) -> InputError:
        """The same error with the column name and a place such as "pass.csv, line 43"."""
        return InputError(f"{label} {self.fault} (first in {place}: {self.value}); {self.remedy}")
