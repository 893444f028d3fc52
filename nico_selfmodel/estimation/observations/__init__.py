"""What was measured, in the form that estimators work on, and what an arm predicts of it."""
