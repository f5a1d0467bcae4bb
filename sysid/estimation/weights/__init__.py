"""How much every reading counts: noise, its correlation in time, and readings that stand out."""
