"""Whole campaigns of trucks with equations of their own, through the command that users type."""
