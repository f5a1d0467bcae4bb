"""What each log and channel shows by itself and beside its neighbours."""
