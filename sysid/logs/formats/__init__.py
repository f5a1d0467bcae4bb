"""One module per format of a log that a library reads."""
