"""The errors that are the user's to mend."""


class UserError(ValueError):
    """A mistake of the user's; the message says what was expected, and hints at what to do."""


class PerturbationError(UserError):
    """A perturbation cannot be applied to a pair of scans."""


class DataError(UserError):
    """Data that cannot be used: the message names the place, what was expected and what to do."""

    def __init__(self, problem, hint):
        super().__init__(f"{problem}\nHint: {hint}")
