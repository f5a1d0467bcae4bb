"""A campaign simulated from its own plan: draws of the vehicle, readings of its sensors, and whether intervals hold."""
