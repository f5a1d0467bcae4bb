"""Errors that reach a user: one plain sentence each, with the exit code of the command line."""

from __future__ import annotations


class SysidError(Exception):
    """Base of every error that is meant for the user rather than for a developer.

    The message is one sentence: what was given (file, column, row, value), what was expected, what to do.
    """

    exit_code = 1


class CampaignError(SysidError):
    """The command line or the campaign file is wrong (exit code 2)."""

    exit_code = 2


class DataRejectedError(SysidError):
    """The campaign file is right, but the data cannot be used (exit code 3)."""

    exit_code = 3


class NumericsError(DataRejectedError):
    """A stage's linear algebra broke down on finite data: they do not determine what it looks for (exit code 3)."""


class StoredResultsError(DataRejectedError):
    """Results that were read back from an output folder cannot be worked with: they were changed (exit code 3)."""


class OutputError(DataRejectedError):
    """The output folder cannot be written: full, read-only, or another process writes to it (exit code 3)."""


class NotConvergedError(SysidError):
    """The estimation stopped before it converged; results were written and marked so (exit code 4)."""

    exit_code = 4
