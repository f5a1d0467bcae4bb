"""The process that does a part of another one's work, started by :mod:`sysid.helper_process`.

It is run as a script.  From standard input come pickled objects of the program itself: first the search path for
modules, the modules to import ahead and after how many new objects garbage is collected, then functions with what they
take; to standard output goes for each whether there is a result, and the result.  The end of its input means that
nobody waits for it any more, and it stops.
"""

from __future__ import annotations

import gc
import importlib
import os
import pickle
import sys
from contextlib import suppress


def main() -> None:
    """Compute items until the input ends."""
    answers, requests = os.fdopen(os.dup(sys.stdout.fileno()), "wb"), os.fdopen(os.dup(sys.stdin.fileno()), "rb")
    # What a library prints must not stand among the answers.
    os.dup2(sys.stderr.fileno(), sys.stdout.fileno())
    sys.path[:], modules, objects_per_collection = pickle.load(requests)
    for module in modules:
        with suppress(Exception):
            importlib.import_module(module)
    # What is imported lives as long as this process; figures are many objects that need not be visited again and again.
    gc.freeze()
    gc.set_threshold(objects_per_collection)
    # Not by the error at its end, which an item may raise as well.
    while requests.peek(1):
        try:
            function, item = pickle.load(requests)
            answer = pickle.dumps((True, function(item)))
        # Whatever goes wrong, it goes wrong once more where the user can be told.
        except Exception:
            answer = pickle.dumps((False, None))
        answers.write(answer)
        answers.flush()


if __name__ == "__main__":
    main()
