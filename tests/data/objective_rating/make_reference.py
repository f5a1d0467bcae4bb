"""Ratings of tests/support/rating_curves.py by another implementation of ISO/TS 18571; writes ratings.json.

pip install objective-rating-metrics==1.3
python tests/data/objective_rating/make_reference.py
"""

from __future__ import annotations

import json
import sys
from pathlib import Path

import numpy as np
from objective_rating_metrics.rating import ISO18571

HERE = Path(__file__).resolve().parent
sys.path.insert(0, str(HERE.parents[1] / "support"))

from rating_curves import INTERVAL_S, rating_curves  # noqa: E402


def rating(measured: np.ndarray, simulated: np.ndarray) -> dict[str, float]:
    time = INTERVAL_S * np.arange(measured.size)
    found = ISO18571(np.column_stack([time, measured]), np.column_stack([time, simulated]), dt=INTERVAL_S)
    names = ("corridor", "phase", "magnitude", "slope", "overall")
    return {name: float(getattr(found, f"{name}_rating")(ndigits=-1)) for name in names}


if __name__ == "__main__":
    ratings = {name: rating(*pair) for name, pair in rating_curves().items()}
    (HERE / "ratings.json").write_text(json.dumps(ratings, indent=1) + "\n", encoding="utf-8")
