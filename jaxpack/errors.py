"""The one exception that says: the input is wrong, not the program."""


class UserError(ValueError):
    """Bad input. The message is one line: what is wrong, where, and what to do."""


MOST = 2**31 - 1
"""The largest count and seed: what int32 holds."""


def check_counts(options: object, *names: str, least: int = 1, most: int = MOST) -> None:
    """Raises UserError naming the first of these attributes that is not from `least` to `most`."""
    for name in names:
        value = getattr(options, name)
        if not least <= value <= most:
            limit = f"at least {least}" if value < least else f"at most {most}"
            raise UserError(f"{name} {value}: give {limit}")
