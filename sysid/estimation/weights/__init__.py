"""The weight of every reading: noise, its correlation in time, and outliers."""
