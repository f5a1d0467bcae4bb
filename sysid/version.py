"""The version of this package, as the installed distribution and the results state it."""

VERSION = "0.1.0"
