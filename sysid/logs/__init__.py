"""Files of loggers: from the bytes of a file to channels with their own time, whatever the format."""
