"""The least-squares fit: where runs start, the minimiser, suspension laws, and what is kept of the result."""
