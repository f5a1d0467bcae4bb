"""The compiled twin of the JAX engine: C++ for this machine's processor, called directly."""
