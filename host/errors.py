"""The one exception of the host that means: the user's input is wrong, and this sentence says how."""


class UsageError(Exception):
    """Bad input: one sentence that says where, what was expected and what was found (exit status 2)."""
