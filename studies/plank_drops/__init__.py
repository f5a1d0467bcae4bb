"""Study of the drop analysis: made plank drops of a quarter car with one departure from the linear law each."""
