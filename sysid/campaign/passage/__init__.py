"""When and how fast the axles of a run pass the bump, as its logs show it."""
