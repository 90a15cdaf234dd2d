"""The one exception that says: the input is wrong, not the program."""


class UserError(ValueError):
    """Bad input. The message is one line: what is wrong, where, and what to do."""
