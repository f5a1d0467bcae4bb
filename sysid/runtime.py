"""Process-wide settings that only entry points make: 64-bit floats and the compilation cache of JAX."""

from __future__ import annotations

import os
from pathlib import Path

from sysid.errors import SysidError


def cache_root() -> Path:
    """Folder for whatever is compiled; ``SYSID_CACHE_DIR`` overrides the user's cache folder."""
    from platformdirs import user_cache_path

    root = os.environ.get("SYSID_CACHE_DIR")
    return Path(root) if root else user_cache_path("sysid")


def cache_folder() -> Path:
    """Folder for functions compiled by JAX, one per version of JAX."""
    import jax

    return cache_root() / f"jax-{jax.__version__}"


def configure() -> None:
    """Switch JAX to 64-bit floats and keep its compiled functions between runs.

    A cache folder that cannot be written is done without.
    """
    import jax

    jax.config.update("jax_enable_x64", True)
    try:
        folder = cache_folder()
        folder.mkdir(parents=True, exist_ok=True)
    except OSError:
        return
    jax.config.update("jax_compilation_cache_dir", str(folder))
    jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.5)


def require_64_bit() -> None:
    """Refuse to go on with 32-bit floats, in which least squares ends short of the minimum.

    Raises
    ------
    SysidError
        If 64-bit floats of JAX are off.
    """
    import jax

    if not jax.config.read("jax_enable_x64"):
        raise SysidError(
            "Least squares needs 64-bit floats; call jax.config.update('jax_enable_x64', True) before the first use."
        )
