"""The discrepancy workflow: find where simulation and measurement part, name what is missing, add it to the model, show what is gone."""
