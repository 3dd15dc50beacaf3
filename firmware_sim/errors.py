"""The one exception that means: the user's input is wrong, and this sentence says how."""


class UsageError(Exception):
    """Bad input: one sentence that says where, what was expected and what was found.

    The command lines print the sentence and exit with status 2; nobody needs a traceback for it.
    """
