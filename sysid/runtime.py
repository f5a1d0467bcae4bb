"""Process-wide settings: 64-bit floats and compiled functions of JAX, where compiled code is kept, and free memory."""

from __future__ import annotations

import ctypes
import gc
import os
import sys
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from functools import cache
from pathlib import Path
from typing import Any

from sysid.errors import SysidError
from sysid.private_files import NotPrivateError, check_owner_of_all, private_folder

#: Heaps of glibc that all threads share: with one for each of JAX's, what compiling leaves free in them adds up to
#: hundreds of megabytes.  The number of that setting of `mallopt`, and the environment variable that goes before it.
_HEAPS, _HEAPS_SETTING, _HEAPS_VARIABLE = 2, -8, "MALLOC_ARENA_MAX"

#: Memory [bytes] from which on a process lets go of compiled functions between stages.
_GROWN = 500e6

#: Share of the memory mappings that a process may have from which on it lets go of compiled functions.
_MOST_OF_MAPPINGS = 0.5

#: New objects after which garbage is collected where figures are drawn; Python says 700.
OBJECTS_PER_COLLECTION = 50_000


class CacheWarning(UserWarning):
    """Why compiled code is not kept where it was asked for."""


def cache_root() -> Path:
    """Folder for whatever is compiled; ``SYSID_CACHE_DIR`` overrides the user's cache folder."""
    root = os.environ.get("SYSID_CACHE_DIR")
    return Path(root) if root else _user_cache()


def _user_cache() -> Path:
    from platformdirs import user_cache_path

    return user_cache_path("sysid")


def private_cache(name: str, check: Callable[[Path], None] | None = None) -> Path:
    """Folder of that name for compiled code, below the cache folder or, if others can write there, the user's own.

    The first time that the cache folder is left alone a warning says so.  `check` looks into the folder and raises what
    is below.

    Raises
    ------
    NotPrivateError
        If others can write to both.
    OSError
        If it cannot be made.
    """

    def usable(root: Path) -> Path:
        folder = private_folder(root / name)
        if check is not None:
            check(folder)
        return folder

    try:
        return usable(cache_root())
    except NotPrivateError as error:
        remedy = f"because {error}; remove it, make it yours alone, or set SYSID_CACHE_DIR to a folder of your own."
        try:
            folder = usable(_user_cache())
        except (NotPrivateError, OSError):
            _say(f"Compiled code is neither kept nor reused {remedy}")
            raise error from None
        _say(f"Compiled code is kept in {_user_cache()} {remedy}")
        return folder


@cache
def _say(sentence: str) -> None:
    warnings.warn(sentence, CacheWarning, stacklevel=3)


def cache_folder() -> Path:
    """Folder for functions compiled by JAX, one per version of JAX; as :func:`private_cache`."""
    from importlib.metadata import version

    return private_cache(f"jax-{version('jax')}", check_owner_of_all)


def configure() -> None:
    """Switch JAX to 64-bit floats and the processor, keep its compiled functions between runs, and share few heaps.

    In a process of our own that has not loaded JAX, its environment says so to it: what needs no JAX does not load it.
    A cache folder that cannot be written is done without, and so is, with a warning, one that others can write to
    (:func:`private_cache`).  SysidError in a process that was forked from one that had computed.
    """
    refuse_fork()
    _use_few_heaps()
    settings: dict[str, Any] = {"jax_enable_x64": True}
    with suppress(NotPrivateError, OSError):
        settings |= {
            "jax_compilation_cache_dir": str(cache_folder()),
            "jax_persistent_cache_min_compile_time_secs": 0.1,
        }
    if _Process.ours and "jax" not in sys.modules:
        if not any(os.environ.get(name) for name in ("JAX_PLATFORMS", "JAX_PLATFORM_NAME", "JAX_DEFAULT_DEVICE")):
            settings["jax_platforms"] = "cpu"
        os.environ |= {name.upper(): str(value) for name, value in settings.items()}
        return
    import jax

    for name, value in settings.items():
        jax.config.update(name, value)
    _use_the_processor()


def _use_the_processor() -> None:
    """Let JAX compute on the processor where it would take a graphics card, unless the user chose the platform.

    The native engine runs on the processor alone, and time steps of a few numbers gain nothing from a card.  A process
    of our own does not open the card at all; in one that may run other code, as a notebook, the processor becomes the
    default device.
    """
    import jax

    # JAX_PLATFORM_NAME is the older name of JAX_PLATFORMS, without a setting that could be read.
    chosen = _setting("jax_platforms") or os.environ.get("JAX_PLATFORM_NAME")
    if chosen or _setting("jax_default_device") is not None:
        return
    if _Process.ours:
        jax.config.update("jax_platforms", "cpu")
    elif jax.default_backend() != "cpu":
        jax.config.update("jax_default_device", jax.devices("cpu")[0])


def platform_of_process() -> str:
    """Name of the platform on which JAX computes here if it is not told where: ``cpu``, ``gpu`` or ``tpu``."""
    import jax

    device = _setting("jax_default_device")
    if device is None:
        return jax.default_backend()
    return device if isinstance(device, str) else str(device.platform)


def _setting(name: str) -> Any:
    """A setting of JAX that its types do not list, as made by the environment, the user's code or `configure`."""
    import jax

    return getattr(jax.config, name)


def return_memory() -> None:
    """Give memory that is free, but that the C library keeps for its threads, back to the system.

    Compiling leaves much of it, in a pool for every thread; only glibc can be asked.
    """
    trim = _of_glibc("malloc_trim")
    if trim is not None:
        trim(0)


class _Process:
    """What is known of this process.

    `ours`: it runs nothing else than this program; `computes`: JAX may have threads in it; `orphan`: it was forked from
    such a process, and these threads did not come along.
    """

    ours = False
    computes = False
    orphan = False


def _forked() -> None:
    _Process.orphan |= _Process.computes


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_forked)


def refuse_fork() -> None:
    """Refuse to compute in a process in which the threads of JAX are missing: it would wait for them without an end.

    From now on, processes that are forked from this one are refused.

    Raises
    ------
    SysidError
        If this process was forked from one that had computed.
    """
    if _Process.orphan:
        raise SysidError(
            "This process was forked from one that had computed before, and threads that it needs did not come along; "
            "start processes by multiprocessing.get_context('spawn')."
        )
    _Process.computes = True


def own_process() -> None:
    """Say that this process runs this program alone: what JAX has compiled in it is ours to let go of."""
    _Process.ours = True


@contextmanager
def fewer_collections() -> Iterator[None]:
    """While it lasts, garbage is collected less often in a process that runs this program alone.

    Figures are made of many objects, which are visited again and again while they are drawn.  Where arrays are
    computed, what is not collected would be large.
    """
    before = gc.get_threshold()
    if _Process.ours:
        gc.set_threshold(OBJECTS_PER_COLLECTION, *before[1:])
    try:
        yield
    finally:
        gc.set_threshold(*before)


def forget_compiled(from_bytes: float | None = None) -> None:
    """Let go of all functions that JAX has compiled in this process, if it has grown: they take a megabyte each.

    Another stage, or another suspension law, needs few of them; what is asked for again comes from the cache folder,
    at a fifth of a second each.  In a process that may run other code, as a notebook, they stay, and only free memory
    is given back, until they take half of the mappings that Linux grants a process: a compiled function has a dozen,
    and the process that asks for more than all of them crashes, after some forty fits.

    Parameters
    ----------
    from_bytes : memory from which on a process has grown, None for 500 MB.
    """
    return_memory()
    jax = sys.modules.get("jax")
    if jax is None:
        return
    grown = _Process.ours and _resident() > (_GROWN if from_bytes is None else from_bytes)
    if grown or _mappings() > _MOST_OF_MAPPINGS * _granted_mappings():
        jax.clear_caches()
        return_memory()


@cache
def _keep_what_is_imported() -> None:
    """Leave the objects of imported modules out of all later garbage collections.

    They live as long as the process, and visiting them takes most of a collection's time.
    """
    gc.freeze()


def _resident() -> float:
    """Memory of this process [bytes], infinite where the system does not say it as Linux does."""
    try:
        pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[1])
    except OSError:
        return float("inf")
    return float(pages * os.sysconf("SC_PAGE_SIZE"))


def _mappings() -> int:
    """Number of memory mappings of this process, 0 where the system does not say it as Linux does."""
    try:
        with Path("/proc/self/maps").open("rb") as lines:
            return sum(1 for _ in lines)
    except OSError:
        return 0


@cache
def _granted_mappings() -> float:
    """How many memory mappings a process may have, infinite where there is no such limit."""
    try:
        return float(Path("/proc/sys/vm/max_map_count").read_text(encoding="ascii"))
    except (OSError, ValueError):
        return float("inf")


def _use_few_heaps() -> None:
    change = _of_glibc("mallopt")
    if change is not None and _HEAPS_VARIABLE not in os.environ:
        change(_HEAPS_SETTING, _HEAPS)


@cache
def _of_glibc(name: str) -> Callable[..., int] | None:
    """A function of the C library where that is glibc."""
    if not sys.platform.startswith("linux"):
        return None
    try:
        library = ctypes.CDLL(None)
        # Others have a `mallopt` without these parameters.
        return getattr(library, name) if hasattr(library, "gnu_get_libc_version") else None
    except (OSError, AttributeError):
        return None


def require_64_bit() -> None:
    """Refuse to go on with 32-bit floats, in which least squares ends short of the minimum.

    Raises
    ------
    SysidError
        If 64-bit floats of JAX are off, or this process was forked from one that had computed.
    """
    refuse_fork()
    import jax

    if _Process.ours:
        _keep_what_is_imported()
    if not jax.config.read("jax_enable_x64"):
        raise SysidError(
            "Least squares needs 64-bit floats; call jax.config.update('jax_enable_x64', True) before the first use."
        )
