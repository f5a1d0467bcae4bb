"""What to measure next: runs, sensors and masses ranked by what they would bring."""

from sysid.planning.advice_records import Advice
from sysid.planning.advise import CANDIDATE_KM_H, advise

__all__ = ["CANDIDATE_KM_H", "Advice", "advise"]
