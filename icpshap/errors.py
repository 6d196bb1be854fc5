"""The base of all errors that are the user's to mend."""


class UserError(ValueError):
    """A mistake of the user's; the message says what was expected, and hints at what to do."""
