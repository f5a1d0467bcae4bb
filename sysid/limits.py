"""Limits on everything that is read: how large, how many, how deep, how long; checked before memory is taken.

They are far above what a measurement of a vehicle needs and low enough that no file takes more than half a gigabyte.
A file beyond one of them is refused in one sentence that names the limit.
"""

from __future__ import annotations

from typing import Final

# ---------------------------------------------------------------- files [bytes]
#: A campaign file: two hundred thousand numbers of a bump given by points take less.
CAMPAIGN_BYTES: Final = 2_000_000
#: One log, one scan, one profile of a bump.
LOG_BYTES: Final = 200_000_000
SCAN_BYTES: Final = 150_000_000
PROFILE_BYTES: Final = 50_000_000
#: A database of CAN messages: those of whole trucks have a few megabytes.
DATABASE_BYTES: Final = 10_000_000
#: All files of a campaign together, a file counted as often as it is read, and the numbers of all logs.
INPUT_BYTES: Final = 4_000_000_000
INPUT_NUMBERS: Final = 50_000_000

# ---------------------------------------------------------------- names
#: Longest name of a file or folder on common file systems, and of a whole relative path [bytes].
NAME_BYTES: Final = 255
PATH_BYTES: Final = 1_000
#: Path of the campaign file or the output folder [characters].
PATH_LENGTH: Final = 4_096
#: Files of a folder from which a campaign file is begun.
FIRST_LOOK_FILES: Final = 2_000
#: Names of a folder that are compared with a name that was not found.
LISTED_FILES: Final = 1_000

# ---------------------------------------------------------------- campaign file (TOML)
#: Parts of a dotted key, such as sensors.bump_run.lvdt1_mm, and depth of lists and tables in each other.
KEY_PARTS: Final = 8
NESTING: Final = 32
#: Characters of one key or number.
KEY_LENGTH: Final = 1_000
#: Keys and tables of the file, and entries of its lists.
KEYS: Final = 40_000
LIST_ENTRIES: Final = 300_000

#: Sensors of the runs, and of the drops.
SENSORS: Final = 1_000

# ---------------------------------------------------------------- text tables
#: Columns and rows of a log, and numbers read from one (rows times columns of sensors).
LOG_COLUMNS: Final = 2_000
LOG_ROWS: Final = 3_000_000
LOG_NUMBERS: Final = 12_000_000
#: Channels of a log that is no table: bus logs have thousands beside those of the sensors.
LOG_CHANNELS: Final = 50_000
#: Columns of a text cloud.
CLOUD_COLUMNS: Final = 200
#: Longest line [characters].
LINE_LENGTH: Final = 1 << 20
#: Lines in which the header of a log is looked for.
HEADER_LINES: Final = 200

# ---------------------------------------------------------------- time
#: Longest log [s], a day and some, and samples between its first and its last stamp at its own rate.
LOG_SECONDS: Final = 100_000.0
LOG_STEPS: Final = 5_000_000
#: A log may span this many times what its rows take at its own rate, and this long beside [s]: more is a clock that
#: jumps, and who simulates the run or lays an even grid over it would work for the pause.
LOG_PAUSES: Final = 10.0
LOG_PAUSE_S: Final = 60.0
#: Steps of an even grid over a record, where its readings are resampled or smoothed.
GRID_STEPS: Final = 2_000_000

# ---------------------------------------------------------------- memory of a fit
#: Derivatives of the residuals of all runs that are held at a time; where they are more, runs are taken in turn.
DERIVATIVES_BYTES: Final = 400_000_000
#: Readings of runs that are simulated together; a run that has more is alone.
GROUP_READINGS: Final = 400_000

#: Longest predicted pass [s]: a road train at walking speed takes less.
PASS_SECONDS: Final = 300.0

# ---------------------------------------------------------------- roads
#: Points of a scan, and largest coordinate [m]: map coordinates stay below 2e7.
CLOUD_POINTS: Final = 4_000_000
COORDINATE_M: Final = 1e8
#: Stations, length [m] and height [m] of a profile from a file.
PROFILE_STATIONS: Final = 100_000
PROFILE_LENGTH_M: Final = 100.0
PROFILE_HEIGHT_M: Final = 1.0
#: Length [m] of a road to predict, its stations in a file, its realisations, and the time [s] that a pass may take.
ROAD_LENGTH_M: Final = 20_000.0
ROAD_STATIONS: Final = 2_000_000
ROAD_REALISATIONS: Final = 50
ROAD_SECONDS: Final = 3600.0
#: Vehicles one behind the other on a bridge.
BRIDGE_VEHICLES: Final = 10
#: Longest pass over a bridge [s].
BRIDGE_SECONDS: Final = 60.0

# ---------------------------------------------------------------- result folders
#: A stage's result or a stretch of a chain; hundreds of thousands of draws of all parameters take less.
STAGE_BYTES: Final = 2_000_000_000
#: What else is read back of a result folder: settings, times, result.json.
RESULT_BYTES: Final = 50_000_000

# ---------------------------------------------------------------- child process of readers that cannot be bounded
#: Memory beyond that of the interpreter and its libraries [bytes], processor time [s], and time on the clock [s], which
#: is long enough for a machine that does ten things at once.
READER_BYTES: Final = 400_000_000
READER_SECONDS: Final = 30.0
READER_WAIT_S: Final = 300.0
#: Processor time of a file without content [s], and what every byte adds [s], up to the limit above: a damaged file of
#: some kilobytes, in which the library goes round in circles, is given up sooner.
READER_START_SECONDS: Final = 7.0
READER_SECONDS_PER_BYTE: Final = 2e-7


def reader_seconds(size: int) -> float:
    """Processor time that the reader of a file of `size` bytes may take [s]: min(30, 7 + 2e-7 size)."""
    return min(READER_SECONDS, READER_START_SECONDS + READER_SECONDS_PER_BYTE * size)
