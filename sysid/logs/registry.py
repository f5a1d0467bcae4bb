"""All formats of logs, and which of them a file has: by its content first, then by its suffix, else text."""

from __future__ import annotations

from dataclasses import replace

from sysid.errors import CampaignError
from sysid.logs import text
from sysid.logs.channels import LogContent, LogFormat, LogRequest
from sysid.logs.error_codes import without_codes
from sysid.logs.formats import arrow, can_bus, excel, hdf5, lvm, mat, mdf, tdms, uff
from sysid.logs.input_file import InputFile
from sysid.logs.sparse_channels import with_own_rows
from sysid.logs.stamps import settled
from sysid.wording import finish, nearest, shorten

#: In the order in which they are tried.
FORMATS: tuple[LogFormat, ...] = (
    mdf.FORMAT,
    tdms.FORMAT,
    mat.FORMAT,
    hdf5.FORMAT,
    arrow.FORMAT,
    excel.FORMAT,
    lvm.FORMAT,
    uff.FORMAT,
    can_bus.FORMAT,
    text.FORMAT,
)
#: Bytes by which a format is recognised: marks stand at the beginning, that of MATLAB 7.3 after 512.
_HEAD_BYTES = 4096
#: A suffix that text logs have as well says nothing about a file that has no mark of a binary format.
_TEXT_TOO = frozenset({".dat", ".asc", ".xls"})


def format_of(file: InputFile, wanted: str | None = None) -> LogFormat:
    """The format of a file: the wanted one by name, else as its content or its suffix says, else text.

    Raises
    ------
    CampaignError
        If no format has the wanted name.
    """
    if wanted is not None:
        for known in FORMATS:
            if known.name == wanted:
                return known
        hint = nearest(wanted, [known.name for known in FORMATS])
        raise CampaignError(finish(f"'{shorten(wanted)}' is no format of a log; {hint}"))
    head = file.data[:_HEAD_BYTES]
    if not head.strip(b"\0"):
        return text.FORMAT
    suffix = file.suffix.lower()
    by_suffix = next((known for known in FORMATS if suffix in known.suffixes and suffix not in _TEXT_TOO), None)
    recognised = [known for known in FORMATS if known.recognises(head)]
    # A MAT file of version 7.3 may be HDF5 from its first byte: among several the suffix decides.
    if by_suffix is not None and (by_suffix in recognised or not recognised):
        return by_suffix
    return recognised[0] if recognised else text.FORMAT


def read_channels(file: InputFile, label: str, request: LogRequest) -> LogContent:
    """Wanted channels of a file of any format, each with its own time, whose stamps advance in seconds.

    Parameters
    ----------
    file, label : the file, and its name, which begins every sentence.
    request : what is wanted.

    Raises
    ------
    CampaignError
        If the package that reads the format is not installed.
    DataRejectedError
        If the file cannot be read.
    """
    content = format_of(file, request.format).read(file, label, request)
    coded = [without_codes(channel, label) for channel in content.channels]
    codes = [sentence for _, sentence in coded if sentence is not None]
    read, sparse = with_own_rows([channel for channel, _ in coded], label)
    clocks = {id(c.clock): c.clock for c in read}
    found = {key: settled(clock, label) for key, clock in clocks.items()}
    channels = tuple(replace(c, clock=found[id(c.clock)][0]) for c in read)
    said = dict.fromkeys(sentence for _, sentences in found.values() for sentence in sentences)
    return replace(content, channels=channels, messages=(*content.messages, *codes, *sparse, *said))
