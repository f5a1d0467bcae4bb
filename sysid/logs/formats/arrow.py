"""Parquet and Feather, by pyarrow: columns of a table; the unit is what a field's metadata call `unit`."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from typing import Any, BinaryIO

import numpy as np

from sysid.logs.by_library import library_format
from sysid.logs.file_channels import FileChannel, RefusedError


def channels_of(stream: BinaryIO, request: dict[str, Any]) -> Iterator[FileChannel]:
    """Columns of the table."""
    import pyarrow as pa

    # One thread: others take address space of their own.
    pa.set_cpu_count(1)
    pa.set_io_thread_count(1)
    if stream.read(4) == b"PAR1":
        yield from _parquet(stream)
    else:
        yield from _feather(stream)


def _parquet(stream: BinaryIO) -> Iterator[FileChannel]:
    from pyarrow.parquet import ParquetFile

    file = ParquetFile(stream, memory_map=False, pre_buffer=False)
    seen: Counter[str] = Counter()
    for field in file.schema_arrow:
        # Asked for a name, the library gives all columns of that name.
        number = seen[field.name]
        seen[field.name] += 1
        yield _file_channel(
            field, file.metadata.num_rows, lambda n=field.name, k=number: file.read([n], use_threads=False).column(k)
        )


def _feather(stream: BinaryIO) -> Iterator[FileChannel]:
    import pyarrow as pa

    stream.seek(0)
    table = pa.ipc.open_file(stream).read_all()
    for place, field in enumerate(table.schema):
        yield _file_channel(field, table.num_rows, lambda i=place: table.column(i))


def _file_channel(field: Any, rows: int, column: Any) -> FileChannel:
    def load() -> tuple[np.ndarray, str | None]:
        import pyarrow as pa

        kind = field.type
        values = column()
        if pa.types.is_decimal(kind):
            values = values.cast(pa.float64())
        elif not (_is_number(pa, kind) or pa.types.is_timestamp(kind) or pa.types.is_duration(kind)):
            raise RefusedError(f"has {str(kind)[:30]} in '{field.name[:60]}', expected numbers; write it as numbers")
        return values.to_numpy(), (field.metadata or {}).get(b"unit")

    return FileChannel(field.name, rows, load)


def _is_number(pa: Any, kind: Any) -> bool:
    return bool(pa.types.is_integer(kind) or pa.types.is_floating(kind))


FORMAT = library_format(
    "arrow",
    "a Parquet or Feather file",
    __name__,
    suffixes=(".parquet", ".feather", ".arrow"),
    recognises=lambda head: head.startswith((b"PAR1", b"ARROW1", b"FEA1")),
    libraries=("pyarrow", "pyarrow.parquet"),
    extra="parquet",
)
