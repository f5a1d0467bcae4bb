from .day import TestDay as TestDay
from .records import DayReport as DayReport
from .records import KnownAxle as KnownAxle
from .records import KnownValue as KnownValue
from .records import LogVerdict as LogVerdict
from .records import PlannedTest as PlannedTest
from .records import StopRule as StopRule
