"""Why data do not fit: fault hypotheses, systematic residuals, changes in time."""
