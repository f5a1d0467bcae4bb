"""Kills: `run --resume` stopped by SIGKILL at any moment, again and again, until it comes to its end."""
