"""The list of parts without links and times: ``python -m tools.plain_parts FILE``.

Makers of packages link to chats, shops and indices, none of which says what is inside.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any


def main() -> None:
    """Write the file again."""
    file = Path(sys.argv[1])
    document = plain(json.loads(file.read_text(encoding="utf-8")))
    file.write_text(json.dumps(document, indent=1, sort_keys=True) + "\n", encoding="utf-8")


def plain(value: Any) -> Any:
    """A part of the document without its links."""
    if isinstance(value, list):
        return [plain(v) for v in value]
    if isinstance(value, dict):
        return {k: plain(v) for k, v in value.items() if k != "externalReferences"}
    return value


if __name__ == "__main__":
    main()
