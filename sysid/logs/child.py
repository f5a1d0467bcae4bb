"""The function that a child process calls to read a log by a library; the parent only sees its answer."""

from __future__ import annotations

import importlib
from typing import Any, BinaryIO

import numpy as np


def read_channels(stream: BinaryIO, request: dict[str, Any]) -> tuple[dict[str, Any], list[np.ndarray]]:
    """Wanted channels of a file: the module `request["module"]` lists what it has, the rest is the same for all."""
    from sysid.logs.selection import RefusedError, selected

    try:
        return selected(importlib.import_module(request["module"]).channels_of(stream, request), request)
    except RefusedError as error:
        return {"refused": str(error)}, []
