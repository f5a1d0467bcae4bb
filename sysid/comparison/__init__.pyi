from .pairs import Comparisons as Comparisons
from .pairs import compare as compare
from .records import Agreement as Agreement
from .records import Campaign as Campaign
from .records import Comparison as Comparison
from .records import Difference as Difference
