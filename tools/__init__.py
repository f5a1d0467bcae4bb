"""Commands for those who make releases."""
