from .evidence import Disagreement as Disagreement
from .evidence import disagreement as disagreement
from .records import AxleLoads as AxleLoads
from .records import BalancedRecord as BalancedRecord
from .records import BalanceEstimate as BalanceEstimate
from .records import ForceBalance as ForceBalance
from .records import LawEstimate as LawEstimate
from .solve import balance_forces as balance_forces
