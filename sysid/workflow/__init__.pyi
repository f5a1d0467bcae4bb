from .calibration import Calibration as Calibration
from .settings import KEPT_CHOICES as KEPT_CHOICES
from .settings import Settings as Settings
from .settings import make_settings as make_settings
from .settings import recall as recall
