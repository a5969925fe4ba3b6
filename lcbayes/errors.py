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
