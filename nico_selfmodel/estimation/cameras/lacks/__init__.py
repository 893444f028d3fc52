"""What cameras and boards did that their model does not have: by score tests at the solution."""
