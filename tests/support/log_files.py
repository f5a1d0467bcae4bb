"""The same log in every format that is read, written by the libraries that own the formats."""

from __future__ import annotations

import io
import tempfile
import warnings
import zipfile
from collections.abc import Callable
from pathlib import Path

import numpy as np

#: Names, units and readings of the log; numbers with few digits are exact in text and in 32 bits.
STEP_S = 0.005
ROWS = 240


def readings() -> dict[str, np.ndarray]:
    """Time [s], a deflection [mm] and two accelerations [g] of a decay."""
    time = STEP_S * np.arange(ROWS)
    decay = np.exp(-2.0 * time)
    return {
        "time_s": time,
        "q_mm": np.round(20.0 * decay * np.cos(9.0 * time), 3),
        "a_g": np.round(0.5 * decay * np.sin(60.0 * time), 5),
        "b_g": np.round(0.1 * decay * np.sin(9.0 * time), 5),
    }


UNITS = {"q_mm": "mm", "a_g": "g", "b_g": "g"}


def csv() -> bytes:
    """The log as text."""
    columns = readings()
    rows = zip(*columns.values(), strict=True)
    lines = [",".join(columns)] + [",".join(repr(float(v)) for v in row) for row in rows]
    return ("\n".join(lines) + "\n").encode()


def _mdf(version: str) -> bytes:
    from asammdf import MDF, Signal

    columns = readings()
    time = columns.pop("time_s")
    with tempfile.TemporaryDirectory() as folder, MDF(version=version) as file:
        file.append([Signal(v, time, name=n, unit=UNITS[n]) for n, v in columns.items()])
        path = file.save(Path(folder, "log.mf4" if version >= "4" else "log.mdf"))
        return Path(path).read_bytes()


def mdf4() -> bytes:
    """MDF 4.10 in one group."""
    return _mdf("4.10")


def mdf3() -> bytes:
    """MDF 3.30 in one group."""
    return _mdf("3.30")


def tdms() -> bytes:
    """TDMS with a time channel in its group."""
    from nptdms import ChannelObject, TdmsWriter

    stream = io.BytesIO()
    with TdmsWriter(stream) as writer:
        writer.write_segment(
            [ChannelObject("log", n, v, {"unit_string": UNITS.get(n, "s")}) for n, v in readings().items()]
        )
    return stream.getvalue()


def tdms_waveform() -> bytes:
    """TDMS with waveforms instead of a time channel."""
    from nptdms import ChannelObject, TdmsWriter

    stream = io.BytesIO()
    wave = {"wf_increment": STEP_S, "wf_start_offset": 0.0, "wf_start_time": np.datetime64("2024-05-01T10:00:00")}
    with TdmsWriter(stream) as writer:
        columns = readings()
        writer.write_segment(
            [ChannelObject("log", n, columns[n], {"unit_string": u, **wave}) for n, u in UNITS.items()]
        )
    return stream.getvalue()


def _mat(**options: object) -> bytes:
    from scipy.io import savemat

    stream = io.BytesIO()
    savemat(stream, readings(), **options)  # type: ignore[arg-type]
    return stream.getvalue()


def mat5() -> bytes:
    """MAT 5 to 7, compressed."""
    return _mat(do_compression=True)


def mat4() -> bytes:
    """MAT 4."""
    return _mat(format="4")


def mat_structure() -> bytes:
    """MAT 5 with the log in a structure."""
    from scipy.io import savemat

    stream = io.BytesIO()
    savemat(stream, {"log": readings()})
    return stream.getvalue()


def mat73() -> bytes:
    """MAT 7.3: HDF5 behind 512 bytes, row vectors, names of types as attributes."""
    import h5py

    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, "log.mat")
        with h5py.File(path, "w", userblock_size=512) as file:
            for name, values in readings().items():
                file.create_dataset(name, data=values[:, None]).attrs["MATLAB_class"] = np.bytes_("double")
        data = bytearray(path.read_bytes())
    data[:128] = b"MATLAB 7.3 MAT-file, Platform: GLNXA64".ljust(124) + b"\x00\x02IM"
    return bytes(data)


def hdf5() -> bytes:
    """HDF5 with data sets in a group, units as attributes."""
    import h5py

    stream = io.BytesIO()
    with h5py.File(stream, "w") as file:
        for name, values in readings().items():
            file.create_dataset(f"log/{name}", data=values, compression="gzip").attrs["unit"] = UNITS.get(name, "s")
    return stream.getvalue()


def _table():
    import pyarrow as pa

    fields = [pa.field(n, pa.float64(), metadata={"unit": UNITS.get(n, "s")}) for n in readings()]
    return pa.table(list(readings().values()), schema=pa.schema(fields))


def parquet() -> bytes:
    """Parquet with units in the metadata of the fields."""
    from pyarrow.parquet import write_table

    stream = io.BytesIO()
    write_table(_table(), stream)
    return stream.getvalue()


def feather() -> bytes:
    """Feather, uncompressed."""
    from pyarrow.feather import write_feather

    stream = io.BytesIO()
    write_feather(_table(), stream, compression="uncompressed")
    return stream.getvalue()


def xlsx(rows: list[list[object]] | None = None) -> bytes:
    """A work book of one sheet as Excel writes it: numbers, and texts in place."""
    columns = readings()
    values = zip(*columns.values(), strict=True)
    table = [list(columns), *([float(v) for v in row] for row in values)] if rows is None else rows
    lines = []
    for i, row in enumerate(table, start=1):
        cells = []
        for j, cell in enumerate(row):
            at = f'r="{chr(65 + j)}{i}"'
            number = isinstance(cell, (int, float))
            cells.append(
                f"<c {at}><v>{cell!r}</v></c>" if number else f'<c {at} t="inlineStr"><is><t>{cell}</t></is></c>'
            )
        lines.append(f'<row r="{i}">{"".join(cells)}</row>')
    main = "http://schemas.openxmlformats.org/spreadsheetml/2006/main"
    office = "http://schemas.openxmlformats.org/officeDocument/2006/relationships"
    package = "http://schemas.openxmlformats.org/package/2006"
    kinds = "application/vnd.openxmlformats-officedocument.spreadsheetml"
    files = {
        "[Content_Types].xml": f'<Types xmlns="{package}/content-types"><Default Extension="rels" '
        'ContentType="application/vnd.openxmlformats-package.relationships+xml"/><Override PartName="/xl/workbook.xml" '
        f'ContentType="{kinds}.sheet.main+xml"/><Override PartName="/xl/worksheets/sheet1.xml" '
        f'ContentType="{kinds}.worksheet+xml"/></Types>',
        "_rels/.rels": f'<Relationships xmlns="{package}/relationships"><Relationship Id="rId1" '
        f'Type="{office}/officeDocument" Target="xl/workbook.xml"/></Relationships>',
        "xl/workbook.xml": f'<workbook xmlns="{main}" xmlns:r="{office}"><sheets><sheet name="log" sheetId="1" '
        'r:id="rId1"/></sheets></workbook>',
        "xl/_rels/workbook.xml.rels": f'<Relationships xmlns="{package}/relationships"><Relationship Id="rId1" '
        f'Type="{office}/worksheet" Target="worksheets/sheet1.xml"/></Relationships>',
        "xl/worksheets/sheet1.xml": f'<worksheet xmlns="{main}"><sheetData>{"".join(lines)}</sheetData></worksheet>',
    }
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, text in files.items():
            archive.writestr(name, '<?xml version="1.0" encoding="UTF-8" standalone="yes"?>' + text)
    return stream.getvalue()


def lvm() -> bytes:
    """LVM as LabVIEW writes it: one X column, decimal comma."""
    columns = readings()
    names = [n for n in columns if n != "time_s"]
    head = [
        "LabVIEW Measurement", "Writer_Version\t2", "Reader_Version\t2", "Separator\tTab", "Decimal_Separator\t,",
        "Multi_Headings\tNo", "X_Columns\tOne", "Time_Pref\tRelative", "***End_of_Header***", "",
        "Channels\t3\t\t", f"Samples\t{ROWS}\t{ROWS}\t{ROWS}", "Y_Unit_Label\t" + "\t".join(UNITS[n] for n in names),
        "X_Dimension\tTime\tTime\tTime", "X0\t0\t0\t0", f"Delta_X\t{STEP_S}\t{STEP_S}\t{STEP_S}".replace(".", ","),
        "***End_of_Header***\t\t\t", "X_Value\t" + "\t".join(names) + "\tComment",
    ]  # fmt: skip
    rows = ["\t".join(repr(float(v)) for v in row).replace(".", ",") for row in zip(*columns.values(), strict=True)]
    return "\r\n".join([*head, *rows, ""]).encode()


def _uff(binary: int) -> bytes:
    import pyuff

    columns = readings()
    time = columns.pop("time_s")
    with tempfile.TemporaryDirectory() as folder:
        path = str(Path(folder, "log.uff"))
        for name, values in columns.items():
            one = pyuff.prepare_58(
                binary=binary, func_type=1, rsp_node=1, rsp_dir=3, ref_dir=1, ref_node=1, data=values, x=time, id1=name,
                rsp_ent_name="NONE", ref_ent_name="NONE", abscissa_spacing=1, abscissa_spec_data_type=17,
                ordinate_spec_data_type=12, orddenom_spec_data_type=0, z_axis_spec_data_type=0,
                ordinate_axis_units_lab=UNITS[name], abscissa_axis_units_lab="s",
            )  # fmt: skip
            with warnings.catch_warnings():
                # The library leaves the file to the garbage collector.
                warnings.simplefilter("ignore", ResourceWarning)
                pyuff.UFF(path).write_sets(one, mode="add")
        return Path(path).read_bytes()


def uff58() -> bytes:
    """Universal file, data sets 58 as text."""
    return _uff(0)


def uff58b() -> bytes:
    """Universal file, binary data sets 58b."""
    return _uff(1)


#: Per format: name of the file, how it is written, and the digits that it keeps as a relative error.
FILES: dict[str, tuple[str, Callable[[], bytes], float]] = {
    "MDF 4": ("log.mf4", mdf4, 0.0),
    "MDF 3": ("log.mdf", mdf3, 0.0),
    "TDMS": ("log.tdms", tdms, 0.0),
    "TDMS waveform": ("log.tdms", tdms_waveform, 0.0),
    "MAT 5": ("log.mat", mat5, 0.0),
    "MAT 4": ("log.mat", mat4, 0.0),
    "MAT structure": ("log.mat", mat_structure, 0.0),
    "MAT 7.3": ("log.mat", mat73, 0.0),
    "HDF5": ("log.h5", hdf5, 0.0),
    "Parquet": ("log.parquet", parquet, 0.0),
    "Feather": ("log.feather", feather, 0.0),
    "Excel": ("log.xlsx", xlsx, 0.0),
    "LVM": ("log.lvm", lvm, 0.0),
    "UFF 58": ("log.uff", uff58, 1e-11),
    "UFF 58b": ("log.uff", uff58b, 0.0),
}
