"""Failing calls: every call of a command to the system fails once, and nothing is lost."""
