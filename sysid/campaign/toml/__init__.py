"""The campaign file: its keys and tables, their validation, and values that are still missing."""
