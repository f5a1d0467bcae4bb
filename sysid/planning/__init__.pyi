from .advice_records import Advice as Advice
from .ranking import CANDIDATE_KM_H as CANDIDATE_KM_H
from .ranking import advise as advise
