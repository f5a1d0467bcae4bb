"""How certain an optimum is: noise, errors of the model, tolerances of masses, and what the data determine."""
